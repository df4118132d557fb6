"""Two frames of KITTI through every door in and out: the clouds are the same, column by column.

Videos (side by side, two files) and ROS 2 bags of SQLite have tests of their own beside this one,
formats of clouds in `test_clouds.py`.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar import PointCloud, StereoFrame, StereoRig
from pseudolidar.cli import main
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.formats.rigs.opencv_rig_writers import write_camera_info, write_opencv
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.rigs.rig_reading import unchanged
from pseudolidar.formats.timestamps import write_timestamps
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from tests.recordings import (
    FoxgloveWriter,
    foxglove_messages,
    ros2_messages,
    write_ros1_bag,
    write_ros2_bag,
    write_ros2_mcap,
)
from tests.videos import write_video

pytestmark = pytest.mark.real
DRIVE = "kitti_raw/2011_09_26/2011_09_26_drive_0002_sync"
FRAMES = "1:5:3"
OWN_COLUMNS = ("xyz", "rgb", "intensity", "sigma_m", "uv")


@dataclass(frozen=True)
class Real:
    """The two frames, where they come from, and their clouds by the direct way."""

    place: Path
    frames: list[StereoFrame]
    out: Path

    @property
    def rig(self) -> StereoRig:
        return self.frames[0].rig

    def clouds(self) -> list[PointCloud]:
        return clouds_in(self.out / "npz")


def clouds_in(folder: Path) -> list[PointCloud]:
    return [read_cloud(path) for path in sorted(folder.iterdir())]


def convert(source: Path, out: Path, to: str, *flags: str) -> Path:
    assert main(["convert", *flags, str(source), str(out), "--to", to]) == 0
    return out


@pytest.fixture(scope="module")
def real(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Real:
    place, out = real_data / DRIVE, tmp_path_factory.mktemp("direct")
    flags = ("--frames", FRAMES, "--frame", "camera_left")
    convert(place, out, "npz,disparity,depth", *flags)
    source = pairs_of(recognise(str(place)).open())
    return Real(place, [source.load(index) for index in (1, 4)], out)


def check_same(got: list[PointCloud], want: list[PointCloud], *, timed: bool = True) -> None:
    """Every column bit for bit, its type, the frame, and the time."""
    assert len(got) == len(want)
    for cloud, same in zip(got, want, strict=True):
        assert cloud.frame == same.frame
        assert cloud.timestamp_ns == same.timestamp_ns or not timed
        assert list(cloud.extra) == list(same.extra)
        columns = {name: (getattr(cloud, name), getattr(same, name)) for name in OWN_COLUMNS}
        columns |= {name: (cloud.extra[name], same.extra[name]) for name in same.extra}
        for name, (ours, theirs) in columns.items():
            assert (ours is None) == (theirs is None), name
            if ours is not None:
                assert ours.dtype == theirs.dtype, name
                np.testing.assert_array_equal(ours, theirs, err_msg=name)


def places_of(points: PointCloud, cloud: PointCloud) -> np.ndarray:
    """Where in `cloud` the point of the same pixel is, -1 for nowhere."""
    found = np.full((1000, 2000), -1)
    u, v = cloud.uv.astype(int).T
    found[v, u] = np.arange(len(cloud))
    u, v = points.uv.astype(int).T
    return found[v, u]


# --- pairs --------------------------------------------------------------------------------------


def pictures(folder: Path, real: Real) -> Path:
    """Folders of pictures with a file of times, without a calibration."""
    for frame in real.frames:
        for eye in ("left", "right"):
            data = encode_png(getattr(frame, eye))
            write_atomic(folder / eye / f"{frame.index:04d}.png", data)
    write_timestamps(folder / "timestamps.txt", [f.timestamp_ns for f in real.frames])
    return folder


def rig_json(folder: Path, real: Real) -> Path:
    write_rig(pictures(folder, real) / "rig.json", real.rig)
    return folder


def opencv(folder: Path, real: Real, suffix: str) -> Path:
    storage = cv2.FileStorage(
        str(pictures(folder, real) / f"stereo{suffix}"), cv2.FILE_STORAGE_WRITE
    )
    storage.write("P1", real.rig.P_left)
    storage.write("P2", real.rig.P_right)
    storage.release()
    return folder


def yaml(folder: Path, real: Real) -> Path:
    write_opencv(pictures(folder, real) / "stereo.yaml", real.rig)
    return folder


def camera_info(folder: Path, real: Real) -> Path:
    place = pictures(folder, real)
    write_camera_info(place / "left.yaml", place / "right.yaml", unchanged(real.rig))
    return folder


def packed_video(folder: Path, real: Real) -> Path:
    both = [np.vstack((frame.left, frame.right)) for frame in real.frames]
    write_video(folder / "drive.mkv", both)
    write_rig(folder / "rig.json", real.rig)
    write_timestamps(folder / "timestamps.txt", [f.timestamp_ns for f in real.frames])
    return folder


def foxglove(folder: Path, real: Real) -> Path:
    folder.mkdir()
    with FoxgloveWriter(folder / "drive.mcap") as writer:
        for topic, message, filed_ns in foxglove_messages(real.frames):
            writer.write(topic, message, filed_ns)
    return folder


def ros2_mcap(folder: Path, real: Real) -> Path:
    folder.mkdir()
    return write_ros2_mcap(folder / "drive.mcap", ros2_messages(real.frames))


def ros2_bag_of_mcap(folder: Path, real: Real) -> Path:
    return write_ros2_bag(folder, ros2_messages(real.frames, raw=True), "mcap")


def ros1_bag(folder: Path, real: Real) -> Path:
    folder.mkdir()
    return write_ros1_bag(folder / "drive.bag", ros2_messages(real.frames))


def our_recording(folder: Path, real: Real, *flags: str) -> Path:
    return convert(real.place, folder, "mcap", "--frames", FRAMES, "--mcap.images", "png", *flags)


def our_pictures(folder: Path, real: Real) -> Path:
    our_recording(folder, real, "--mcap.split", "images,clouds")
    (images,) = folder.glob("*_images.mcap")
    return images


def our_bag(folder: Path, real: Real) -> Path:
    return our_recording(folder, real, "--mcap.profile", "ros2")


def training_tree(folder: Path, real: Real) -> Path:
    return convert(real.place, folder, "kitti", "--frames", FRAMES) / "kitti"


PAIRS: dict[str, Callable[[Path, Real], Path]] = {
    "pictures and rig.json": rig_json,
    "OpenCV XML": lambda folder, real: opencv(folder, real, ".xml"),
    "OpenCV JSON": lambda folder, real: opencv(folder, real, ".json"),
    "OpenCV YAML, ours": yaml,
    "ROS camera_info": camera_info,
    "top-bottom video": packed_video,
    "Foxglove MCAP": foxglove,
    "ROS 2 MCAP": ros2_mcap,
    "ROS 2 bag of MCAP, raw pictures": ros2_bag_of_mcap,
    "ROS 1 bag": ros1_bag,
    "our pictures": our_pictures,
    "our ROS 2 bag": our_bag,
    "training tree": training_tree,
}


@pytest.mark.parametrize("door", PAIRS)
def test_pairs_by_any_door_are_the_same_clouds(door: str, real: Real, tmp_path: Path) -> None:
    source = PAIRS[door](tmp_path / "ein Ordner für Daten", real)
    recorded = any(kind in door for kind in ("MCAP", "bag"))
    flags = ["--take", "pairs"] if recorded else []
    convert(source, tmp_path / "out", "npz", "--frame", "camera_left", *flags)
    check_same(clouds_in(tmp_path / "out" / "npz"), real.clouds(), timed=door != "training tree")


def test_kitti_of_2012_is_that_of_2015(real_data: Path, tmp_path: Path) -> None:
    data, tree = real_data / "kitti_stereo2015" / "training", tmp_path / "2012" / "training"
    name = "000002"
    renamed = {"colored_0": "image_2", "colored_1": "image_3", "disp_occ": "disp_occ_0"}
    for old, new in renamed.items():
        (tree / old).mkdir(parents=True)
        shutil.copy(data / new / f"{name}_10.png", tree / old)
    for old, new in (("image_0", "image_2"), ("image_1", "image_3")):
        grey = cv2.imread(str(data / new / f"{name}_10.png"), cv2.IMREAD_GRAYSCALE)
        write_atomic(tree / old / f"{name}_10.png", encode_png(grey))
    lines = (data / "calib_cam_to_cam" / f"{name}.txt").read_text().splitlines()
    rows = dict(line.split(":", 1) for line in lines if ":" in line)
    text = "".join(f"P{k}:{rows[f'P_rect_0{k}']}\n" for k in range(4))
    write_atomic(tree / "calib" / f"{name}.txt", text.encode())
    convert(tree, tmp_path / "old", "npz")
    flags = ("--frames", f"{name}_10", "--frame", "camera_left")
    convert(data, tmp_path / "new", "npz", *flags)
    check_same(clouds_in(tmp_path / "old" / "npz"), clouds_in(tmp_path / "new" / "npz"))


@pytest.mark.parametrize("kind", ["disparity", "depth"])
def test_our_own_maps_are_our_own_clouds_to_what_a_png_rounds(
    kind: str, real: Real, tmp_path: Path
) -> None:
    flags = ("--frames", FRAMES, "--frame", "camera_left", f"--{kind}", str(real.out / kind))
    convert(real.place, tmp_path, "npz", *flags)
    for cloud, want in zip(clouds_in(tmp_path / "npz"), real.clouds(), strict=True):
        assert abs(len(cloud) - len(want)) < 10, "those at the farthest depth"
        at = places_of(want, cloud)
        both = at >= 0
        assert both.sum() > len(want) - 10
        np.testing.assert_array_equal(cloud.rgb[at[both]], want.rgb[both])
        Z = want.xyz[both, 2]
        # Half a step of 1/256: of disparity, which moves Z by Z^2 / fB, or of Z itself.
        half = 1 / 512
        allowed = half * (Z**2 / real.rig.fB_px_m if kind == "disparity" else 1.0)
        off = np.abs(cloud.xyz[at[both], 2] - Z)
        assert np.all(off <= 1.05 * allowed + 1e-5 * Z)


# --- clouds -------------------------------------------------------------------------------------


def test_a_scan_through_every_format_in_turn(real: Real, tmp_path: Path) -> None:
    """Of a bag to PCD, our recording, PLY, a bag of ours, and at last a .bin: KITTI's own file."""
    at = write_ros2_bag(tmp_path / "bag", ros2_messages(real.frames), "mcap")
    steps = ("npz", "pcd", "mcap", "ply:ascii", "mcap --mcap.profile ros2", "pcd:compressed", "ply")
    want: list[PointCloud] = []
    for number, step in enumerate(steps):
        to, *flags = step.split()
        flags += ["--take", "clouds"] if number == 0 else []
        out = convert(at, tmp_path / str(number), to, *flags)
        at = out if to == "mcap" else out / to.partition(":")[0]
        if to != "mcap":
            want = want or clouds_in(at)
            check_same(clouds_in(at), want)
    convert(at, tmp_path / "bin", "bin")
    for number, (frame, cloud) in enumerate(zip(real.frames, want, strict=True)):
        original = real.place / "velodyne_points" / "data" / f"{frame.index:010d}.bin"
        written = tmp_path / "bin" / "bin" / f"{number:06d}.bin"
        assert written.read_bytes() == original.read_bytes()
        np.testing.assert_array_equal(cloud.xyz, read_velodyne_bin(original).xyz)


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_a_stereo_cloud_comes_out_of_our_recording_as_it_went_in(
    profile: str, real: Real, tmp_path: Path
) -> None:
    flags = ["--mcap.max-points", "0", "--mcap.pixels", "--mcap.compression", "zstd"]
    flags += ["--frame", "camera_left", "--frames", FRAMES, "--mcap.profile", profile]
    out = convert(real.place, tmp_path / "recorded", "mcap", *flags)
    (recording,) = out.glob("*.mcap")
    convert(recording, tmp_path / "back", "npz", "--take", "clouds")
    check_same(clouds_in(tmp_path / "back" / "npz"), real.clouds())


def test_draco_keeps_colours_and_sigma_and_places_to_a_millimetre(
    real: Real, tmp_path: Path
) -> None:
    pytest.importorskip("DracoPy", reason="the extra draco is not installed")
    flags = ["--mcap.cloud-format", "draco", "--thin", "uniform:40000"]
    out = convert(real.out / "npz", tmp_path / "packed", "mcap", *flags)
    convert(out, tmp_path / "back", "npz")
    rounded = 0.001 + 1e-6
    for cloud, same in zip(clouds_in(tmp_path / "back" / "npz"), real.clouds(), strict=True):
        assert (cloud.frame, cloud.timestamp_ns) == (same.frame, same.timestamp_ns)
        at = places_of(cloud, same)
        assert len(np.unique(at)) == len(cloud) == 40_000
        assert at.min() >= 0
        for name in ("rgb", "intensity", "sigma_m"):
            np.testing.assert_array_equal(getattr(cloud, name), getattr(same, name)[at])
        assert np.abs(cloud.xyz - same.xyz[at]).max() <= rounded
