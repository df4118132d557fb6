"""Clouds of a drive in one frame: what stands still lies on itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pseudolidar.cli import main
from pseudolidar.formats.points.cloud_file import read_cloud

pytestmark = pytest.mark.real
LEAST_HEIGHT_M, FARTHEST_M = 1.2, 30.0


@pytest.fixture(scope="module")
def recording(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """First and tenth frame of KITTI drive 0002, 8.2 m apart."""
    out = tmp_path_factory.mktemp("merge")
    drive = real_data / "kitti_raw" / "2011_09_26"
    assert main(["convert", str(drive), str(out), "--to", "mcap", "--frames", "0:10:9"]) == 0
    return next(out.glob("*.mcap"))


def apart_m(recording: Path, out: Path, *flags: str) -> float:
    """Median distance of points above the road in one frame from the nearest of the other."""
    assert main(["merge", str(recording), str(out), "--overwrite", *flags]) == 0
    cloud = read_cloud(out)
    high = cloud.xyz[:, 2] > np.percentile(cloud.xyz[:, 2], 10) + LEAST_HEIGHT_M
    near = np.linalg.norm(cloud.xyz, axis=1) < FARTHEST_M
    first, last = (
        cloud.xyz[high & near & (cloud.extra["frame_index"] == index)]
        for index in np.unique(cloud.extra["frame_index"])
    )
    return float(np.median(cKDTree(first).query(last[::10])[0]))


@pytest.mark.parametrize(("topic", "most_m"), [("/velodyne/points", 0.12), ("/stereo/points", 0.4)])
def test_walls_lie_on_themselves_by_the_poses_and_not_without(
    topic: str, most_m: float, recording: Path, tmp_path: Path
) -> None:
    flags = ("--topic", topic)
    by_poses = apart_m(recording, tmp_path / "a.ply", *flags)
    without = apart_m(recording, tmp_path / "a.ply", *flags, "--frame", "velodyne")
    assert by_poses < most_m
    assert without > 3 * by_poses
