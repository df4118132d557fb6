"""What a path is, by what is in it."""

from __future__ import annotations

import difflib
from pathlib import Path

from pseudolidar.errors import SourceUnknown
from pseudolidar.formats.recordings.kinds import recordings_in
from pseudolidar.sources.asked_layout import seen_in
from pseudolidar.sources.body import Body
from pseudolidar.sources.cloud_files import CloudFiles
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.kitti.extract import KittiExtract
from pseudolidar.sources.kitti.object import KittiObject
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.middlebury import Middlebury
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.synthetic import SYNTHETIC, Synthetic, world_and_frames
from pseudolidar.sources.tum_depth import TumDepth
from pseudolidar.sources.video.videos import Video

Source = (
    KittiRaw
    | KittiExtract
    | KittiObject
    | KittiStereo
    | KittiOdometry
    | Middlebury
    | Body
    | Folders
    | TumDepth
    | Video
    | CloudFiles
    | Recording
    | Synthetic
)

# The stricter layout first: KITTI's are folders of pairs, too.
LAYOUTS = (
    KittiExtract,
    KittiRaw,
    KittiObject,
    KittiStereo,
    KittiOdometry,
    Middlebury,
    Recording,
    Body,
    Folders,
    TumDepth,
    Video,
    CloudFiles,
)
LOOKED_FOR = (
    "KITTI raw, object, stereo or odometry data, Middlebury or ETH3D scenes, "
    "pairs of pictures (folders left and right, names with left and right, _l and _r, "
    "im0 and im1), videos (left.mp4 and right.mp4, _l and _r, _0 and _1, or one with both eyes), "
    "pictures with depth (folders rgb and depth), "
    "a rig.json of several pairs with a folder for each, "
    "files of clouds (pcd, ply, bin, npz), a recording (MCAP, ROS bag), "
    "or synthetic:street"
)


def recognise(path: str) -> Source:
    """Settings of the source that `path` is: a folder, or `synthetic:WORLD[:FRAMES]`.

    Raises:
        SourceUnknown: nothing known; says what was looked for and what is there.
        UsageError: a number of frames that is none.
    """
    if path.startswith(SYNTHETIC):
        return _synthetic(path)
    place = Path(path)
    if not place.exists():
        raise _absent(path)
    refuse_special(place)
    for layout in LAYOUTS:
        if layout.looks_like(place):
            return layout(path)
    recordings = recordings_in(place)
    if len(recordings) == 1:
        return Recording(str(recordings[0]))
    if recordings:
        names = ", ".join(file.name for file in recordings[:6])
        raise SourceUnknown(
            f"{len(recordings)} recordings: {names}",
            want="one of them",
            fix=f"Give the one that is meant: {str(recordings[0])!r}.",
            path=path,
        )
    raise SourceUnknown(
        seen_in(place) if place.is_dir() else f"a file of {place.stat().st_size} bytes",
        want=LOOKED_FOR,
        fix="Name its kind by --source, or its pictures by --source folders "
        "--left-pattern 'a_*.png' --right-pattern 'b_*.png'.",
        path=path,
    )


def refuse_special(place: Path) -> None:
    """Refuse what is neither file nor folder: to read a pipe is to wait for somebody to write.

    Raises:
        SourceUnknown: a pipe, a socket, a device.
    """
    if place.is_file() or place.is_dir():
        return
    kinds = {"a named pipe": place.is_fifo(), "a socket": place.is_socket()}
    what = next((kind for kind, is_one in kinds.items() if is_one), "a device")
    raise SourceUnknown(
        what, want="a file or a folder", fix="Write what it gives into a file.", path=place
    )


def _synthetic(path: str) -> Synthetic:
    name, frames = world_and_frames(path)
    return Synthetic(name) if frames is None else Synthetic(name, frames=frames)


def _absent(path: str) -> SourceUnknown:
    place = Path(path)
    beside = [entry.name for entry in place.parent.iterdir()] if place.parent.is_dir() else []
    if place.is_symlink():
        got = "a link that leads to nothing, or to itself"
        return SourceUnknown(got, want=LOOKED_FOR, fix="Mend the link.", path=path)
    near = difflib.get_close_matches(place.name, beside, n=1)
    fix = f"Did you mean {str(place.parent / near[0])!r}?" if near else "Check the path."
    return SourceUnknown("no such file or folder", want=LOOKED_FOR, fix=fix, path=path)
