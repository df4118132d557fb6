"""The recording of a map: frames where they were taken, the way, and the map as it came into view.

It is written when path and map are known, so that every pose in it is the final one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.frames import BASE_LINK, MAP, left_in_base_link
from pseudolidar.geometry.twists import inverted, rigid
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.mapped.stored import read_stored
from pseudolidar.running.mapped.trajectory_files import body_poses_of
from pseudolidar.running.mapped.walked import Piece
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import packed
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSource
from pseudolidar.stereo.reproject import Reproject, Reprojector
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.frame import FramePart

POSES_OF_MOTION = "of the pairs' own motion: map is base_link of the first frame"
# The way and the map are told so many times at most: they grow.
MOST_SNAPSHOTS = 20
# Points of a snapshot, and how far ahead of a camera they came into view, m.
SNAPSHOT_POINTS, IN_VIEW_M = 250_000, 40.0
# Which points a smaller map keeps.
SEED = 7


@dataclass(frozen=True)
class RecordFrame:
    """A frame to its part of the recording: picklable, one thread.

    Args:
        folder: output folder, with the disparities of the first pass.
        rig: with the correction that motion told.
        T_map_base: by id of the frame.
        extrapolated: why nothing was measured, by id of such frames.
        content: what the recording holds.
        reproject: disparity to points.
    """

    folder: Path
    rig: StereoRig
    T_map_base: Mapping[str, Float64]
    extrapolated: Mapping[str, str]
    content: McapContent
    reproject: Reprojector

    def __call__(self, frame: StereoFrame) -> dict[str, FramePart]:
        """Encode.

        Raises:
            ImageUnreadable: somebody changed the file of disparities.
        """
        pose = Pose(MAP, BASE_LINK, self.T_map_base[frame.id])
        placed = replace(frame, rig=self.rig, pose=pose, notes=self._notes(frame))
        disparity = read_stored(self.folder, frame.id)
        cloud = self.reproject(placed, disparity)
        depth = depth_map(disparity, self.rig)
        return packed(Converted(placed, cloud, disparity, depth), self.content)

    def _notes(self, frame: StereoFrame) -> tuple[str, ...]:
        why = self.extrapolated.get(frame.id)
        if why is None:
            return frame.notes
        return (*frame.notes, f"pose extrapolated, between the frames beside it: {why}")


def plan_recording(job: Any, source: FrameSource, *, wanted: bool) -> RecordingPlan:
    """A recording that tells where its poses come from."""
    plan = RecordingPlan.of(job, source, wanted=wanted)
    if plan.prolog is None:
        return plan
    metadata = {**plan.prolog.metadata, "poses": POSES_OF_MOTION}
    return replace(plan, prolog=replace(plan.prolog, metadata=metadata))


def write_recording(
    folder: Path,
    source: FrameSource,
    piece: Piece,
    rig: StereoRig,
    whole: PointCloud | None,
    *,
    plan: RecordingPlan,
    content: McapContent,
    crew: CrewPlan,
) -> tuple[Path, ...]:
    """Write the frames of a piece of path.

    Args:
        folder: output folder, with the disparities of the first pass.
        source: the frames.
        piece: where they were taken.
        rig: with the correction that motion told.
        whole: the map; None for none.
        plan: the recording.
        content: what it holds.
        crew: how frames are encoded.

    Returns:
        Its files.

    Raises:
        OutputError: the disk is full or gone.
        RecordingError: it does not read back as it should.
    """
    poses = body_poses_of(piece, rig)
    ids = [one.id for one in piece.frames]
    snapshots = Snapshots(piece, rig, whole)
    T_map_base = {name: rigid(T) for name, T in zip(ids, poses, strict=True)}
    extrapolated = {one.id: one.why for one in piece.frames if not one.measured}
    reproject = Reproject().load()
    per_frame = RecordFrame(folder, rig, T_map_base, extrapolated, content, reproject)
    with plan.open(folder, ids) as log, FrameProgress(len(ids), what="recording") as progress:
        others = frozenset(source.ids) - (frozenset(ids) - log.held)
        for frame in stream(source, per_frame, crew=crew, skip=others):
            if isinstance(frame, Done):
                number = ids.index(frame.id)
                log.append(frame.id, snapshots.beside(frame.value, number, frame.index, content))
            progress.advance()
    return tuple(folder / name for name in plan.files.values())


class Snapshots:
    """The way and the map as they were known, or came into view, until a frame.

    Args:
        piece: of path.
        rig: of its frames.
        whole: the map at the end; None for none.
    """

    def __init__(self, piece: Piece, rig: StereoRig, whole: PointCloud | None) -> None:
        self._times_ns = piece.times_ns.tolist()
        self._poses = [Pose(MAP, BASE_LINK, rigid(T)) for T in body_poses_of(piece, rig)]
        self._map = None if whole is None else fewer(whole, SNAPSHOT_POINTS)
        T_map_cameras = left_in_base_link(rig).matrix @ piece.T_odom_camera
        self._since = None if self._map is None else in_view_since(self._map, rig, T_map_cameras)
        count = len(self._poses)
        self._at = frozenset(range(0, count, -(-count // MOST_SNAPSHOTS))) | {count - 1}

    def beside(
        self, parts: Mapping[str, FramePart], number: int, index: int, content: McapContent
    ) -> dict[str, FramePart]:
        """A frame's parts with the way and the map, where it is their turn.

        Args:
            parts: as a worker packed them.
            number: of the frame on the path.
            index: in the source.
            content: what the recording holds.
        """
        if number not in self._at:
            return dict(parts)
        from pseudolidar.formats.mcap.frame import with_more
        from pseudolidar.formats.mcap.items import Way
        from pseudolidar.formats.mcap.messages import path_messages
        from pseudolidar.formats.mcap.split import split_messages

        way = Way(tuple(self._poses[: number + 1]), tuple(self._times_ns[: number + 1]))
        by_then = None
        if self._map is not None and self._since is not None:
            by_then = self._map[self._since <= number]
        messages = path_messages(way, by_then, timestamp_ns=self._times_ns[number], content=content)
        by_file = split_messages(messages, content.split)
        return {
            ending: with_more(part, by_file[ending], index=index, compression=content.compression)
            for ending, part in parts.items()
        }


def fewer(cloud: PointCloud, most: int) -> PointCloud:
    """At most so many points of a cloud, evenly chosen; the same ones each time."""
    if len(cloud) <= most:
        return cloud
    chosen = np.random.default_rng(SEED).choice(len(cloud), most, replace=False)
    return cloud[np.sort(chosen)]


def in_view_since(cloud: PointCloud, rig: StereoRig, T_map_cameras: Float64) -> Int64:
    """(N,) number of the first camera that a point lies in front of; of none, of the last.

    Args:
        cloud: in the map.
        rig: of the cameras.
        T_map_cameras: (M, 4, 4).
    """
    since = np.full(len(cloud), len(T_map_cameras) - 1, np.int64)
    unseen = np.arange(len(cloud))
    K, (width, height) = rig.left.K, rig.left.size_px
    for number, T in enumerate(T_map_cameras):
        back = inverted(T)
        xyz = np.einsum("ij,nj->ni", back[:3, :3], cloud.xyz[unseen].astype(np.float64))
        x, y, z = (xyz + back[:3, 3]).T
        ahead = np.maximum(z, 1e-6)
        u, v = K[0, 0] * x / ahead + K[0, 2], K[1, 1] * y / ahead + K[1, 2]
        seen = (z > 0) & (z < IN_VIEW_M) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        since[unseen[seen]] = number
        unseen = unseen[~seen]
    return since
