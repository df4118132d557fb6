"""Real data as recordings: KITTI in a ROS 2 bag, and a recording of somebody else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert, run

from pseudolidar.errors import SourceEmpty
from pseudolidar.formats.mcap.reader import open_mcap
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.selection import FrameSelection
from pseudolidar.sources.source import pairs_of
from tests.recordings import ros2_messages, write_ros2_bag

pytestmark = pytest.mark.real
FRAMES = 3


@pytest.fixture(scope="module")
def bag(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drive 0002 as a car with ROS 2 would have recorded it, pictures as PNG."""
    source = pairs_of(recognise(str(real_data / "kitti_raw" / "2011_09_26")).open())
    frames = [source.load(index) for index in range(FRAMES)]
    return write_ros2_bag(tmp_path_factory.mktemp("kitti") / "bag", ros2_messages(frames))


def convert(source: Path, out: Path, frame: str | None) -> None:
    frames = FrameSelection.parse(f"0:{FRAMES}")
    to = Outputs.parse("pcd")
    run(Convert(recognise(str(source)), out, to=to, frames=frames, frame=frame))


def test_clouds_from_a_bag_are_those_from_the_pictures(
    real_data: Path, bag: Path, tmp_path: Path
) -> None:
    """In the camera to the last byte; in the Velodyne's frame to what a quaternion rounds.

    KITTI's rotations are orthonormal to 5e-8 only; transforms are exact rotations.
    """
    pictures = real_data / "kitti_raw" / "2011_09_26"
    for frame in ("camera_left", "velodyne"):
        convert(pictures, tmp_path / frame / "pictures", frame)
        convert(bag, tmp_path / frame / "bag", frame)
    for index in range(FRAMES):
        one = (tmp_path / "camera_left/pictures/pcd" / f"{index:010d}.pcd").read_bytes()
        other = (tmp_path / "camera_left/bag/pcd" / f"{index:06d}.pcd").read_bytes()
        assert one == other
        a = read_pcd(tmp_path / "velodyne/pictures/pcd" / f"{index:010d}.pcd")
        b = read_pcd(tmp_path / "velodyne/bag/pcd" / f"{index:06d}.pcd")
        assert (a.frame, a.timestamp_ns) == (b.frame, b.timestamp_ns)
        np.testing.assert_allclose(a.xyz, b.xyz, rtol=0, atol=2e-5)
        np.testing.assert_array_equal(a.rgb, b.rgb)
        for name in ("sigma_m", "uv", "intensity"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_scans_and_poses_are_those_of_the_data_set(real_data: Path, bag: Path) -> None:
    source = pairs_of(recognise(str(real_data / "kitti_raw" / "2011_09_26")).open())
    recorded = pairs_of(recognise(str(bag)).open())
    for index in range(FRAMES):
        want, got = source.load(index), recorded.load(index)
        assert want.scan is not None
        assert got.scan is not None
        np.testing.assert_array_equal(want.scan.xyz, got.scan.xyz)
        np.testing.assert_array_equal(want.scan.reflectance, got.scan.reflectance)
        assert want.pose is not None
        assert got.pose is not None
        np.testing.assert_allclose(want.pose.matrix, got.pose.matrix, atol=1e-6)


def test_scans_of_a_bag_are_the_files_they_came_from(
    real_data: Path, bag: Path, tmp_path: Path
) -> None:
    run(Convert(Recording(str(bag), take="clouds"), tmp_path, to=Outputs.parse("bin,pcd")))
    drive = real_data / "kitti_raw/2011_09_26/2011_09_26_drive_0002_sync/velodyne_points/data"
    for index in range(FRAMES):
        original = drive / f"{index:010d}.bin"
        written = tmp_path / "bin" / f"{index:06d}.bin"
        assert written.read_bytes() == original.read_bytes()
        scan, cloud = read_velodyne_bin(original), read_pcd(tmp_path / f"pcd/{index:06d}.pcd")
        np.testing.assert_array_equal(cloud.xyz, scan.xyz)
        assert cloud.frame == "velo_link"


def test_a_recording_of_another_robot_opens_and_says_what_it_has(real_data: Path) -> None:
    path = real_data / "mcap" / "nav2_turtlebot.mcap"
    store = open_mcap(path)
    counts = {c.topic: len(store.times_ns(i)) for i, c in enumerate(store.channels)}
    assert counts == {"/odom": 2639, "/tf": 5422, "/tf_static": 1, "/amcl_pose": 135}
    with pytest.raises(SourceEmpty, match=r"/odom \(pose, 2639\), /tf \(transforms, 5422\)"):
        recognise(str(path)).open()
