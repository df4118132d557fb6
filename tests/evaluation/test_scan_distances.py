"""Stereo clouds against scans, with known answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import ReferenceMissing, StructureError
from pseudolidar.evaluation.comparison.bins import DepthBins
from pseudolidar.evaluation.comparison.clouds import compare_clouds
from pseudolidar.evaluation.scan_distances import distances_to_scan
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose

FOCAL_PX, SIZE = 700.0, (400, 160)
WALL_M = 12.0


def rig() -> StereoRig:
    K = np.array([[FOCAL_PX, 0, 200.0], [0, FOCAL_PX, 80.0], [0, 0, 1]])
    shift = Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.5, 0, 0]))
    # the LiDAR stands where the camera does, its axes turned
    forward = np.array([[0, -1.0, 0], [0, 0, -1.0], [1.0, 0, 0]])
    velodyne = Pose.from_rotation("camera_left", "velodyne", forward, np.zeros(3))
    right = Camera(K, *SIZE, frame="camera_right")
    return StereoRig(Camera(K, *SIZE), right, shift, T_left_velodyne=velodyne)


def points(depth_m: float, *, rows=(40, 160), columns=(0, 400), steps=(1.0, 1.0)) -> np.ndarray:
    """A wall across the view, in the left camera's frame, at pixels of a grid."""
    grid = np.meshgrid(np.arange(*rows, steps[0]), np.arange(*columns, steps[1]), indexing="ij")
    v, u = (axis.ravel() for axis in grid)
    rays = np.stack([(u - 200) / FOCAL_PX, (v - 80) / FOCAL_PX, np.ones_like(u)], axis=1)
    return rays * depth_m


def frame_with(*walls: np.ndarray) -> StereoFrame:
    """A frame whose scan has these points of the left camera's frame."""
    image = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    xyz = np.concatenate(walls)
    velodyne = rig().T_left_velodyne.inverse().apply(xyz).astype(np.float32)
    return StereoFrame(image, image, rig(), "0", 0, 0, scan=LidarScan(velodyne))


def cloud_of(*walls: np.ndarray) -> PointCloud:
    return PointCloud(np.concatenate(walls).astype(np.float32), "camera_left")


# Beams of all rows and columns of the lower part: a sensor that sees no sky.
SCANNED = points(WALL_M)


def figures(cloud: PointCloud, frame: StereoFrame, **options):
    distances = distances_to_scan(cloud, frame, **options)
    return compare_clouds([distances], bins=DepthBins((5, 20, 40))).overall


def test_a_wall_15_cm_too_far():
    # the same pixels, so the cloud is a little larger than the scan and its neighbours lie slanted
    found = figures(cloud_of(points(WALL_M + 0.15)), frame_with(SCANNED)).figures
    assert found["accuracy_median_m"] == pytest.approx(0.15, abs=0.002)
    assert found["completeness_median_m"] == pytest.approx(0.15, abs=0.002)
    assert found["chamfer_m"] == pytest.approx(0.15, abs=0.002)
    assert (found["f_score_0_1"], found["f_score_0_2"], found["f_score_0_5"]) == (0, 1, 1)


def test_half_a_cloud_is_accurate_and_half_complete():
    found = figures(cloud_of(points(WALL_M, columns=(0, 200))), frame_with(SCANNED)).figures
    assert found["accuracy_m"] < 1e-6
    # the wall goes on 0.1 m, 5.8 of the 200 missing columns, beyond what the cloud has of it
    assert found["recall_0_1"] == pytest.approx((200 + 5) / 400, abs=0.003)
    assert found["precision_0_1"] == 1


def test_ghosts_cost_accuracy_and_no_completeness():
    ghosts = points(7.0, rows=(60, 120), columns=(100, 200))
    found = figures(cloud_of(points(WALL_M), ghosts), frame_with(SCANNED))
    # 6000 of 54 000 points; the first and last rows and columns have no beam on every side
    wrong = 1 - found.figures["precision_0_5"]
    assert wrong == pytest.approx(6000 / found.n)
    assert 0.1 < wrong < 0.13
    assert found.figures["recall_0_1"] == 1


def test_ghosts_before_a_wall_are_not_excused_by_what_the_camera_cannot_see():
    board = points(8.0, rows=(60, 120), columns=(100, 200))
    behind = points(11.0, rows=(60, 120), columns=(110, 190))  # a LiDAR elsewhere sees it
    ghosts = points(11.0, rows=(70, 110), columns=(120, 180))
    frame = frame_with(SCANNED, board, behind)
    found = figures(cloud_of(points(WALL_M), board, ghosts), frame)
    # at 0.5 m both ghosts and points of the wall that the board hides are wrong: none is near
    assert (1 - found.figures["precision_0_5"]) * found.n > ghosts.shape[0]
    assert found.figures["recall_0_1"] == 1


def test_sky_and_ranges_are_not_judged():
    sky = points(15.0, rows=(0, 30))
    far = points(30.0, steps=(2.0, 2.0))
    alone = figures(cloud_of(points(WALL_M)), frame_with(SCANNED))
    assert figures(cloud_of(points(WALL_M), sky), frame_with(SCANNED)).n == alone.n
    scene = frame_with(
        points(WALL_M, columns=(0, 200)), points(30.0, columns=(200, 400), steps=(2.0, 2.0))
    )
    cut = figures(cloud_of(points(WALL_M), far), scene, range_m=(0.0, 20.0))
    whole = figures(cloud_of(points(WALL_M), far), scene)
    assert cut.reference < whole.reference
    assert cut.figures["completeness_m"] < 1e-6


def test_it_is_the_same_each_time():
    rng = np.random.default_rng(1)
    wall = points(WALL_M, rows=(0, 160), steps=(0.5, 1.0))[:120_000]
    noisy = wall * (1 + 0.01 * rng.standard_normal((len(wall), 1)))
    cloud, frame = cloud_of(noisy), frame_with(wall)
    assert len(wall) == 120_000
    found, again = (distances_to_scan(cloud, frame) for _ in range(2))
    np.testing.assert_array_equal(found.accuracy_m, again.accuracy_m)
    np.testing.assert_array_equal(found.completeness_m, again.completeness_m)


def test_nothing_to_compare():
    frame = frame_with(SCANNED)
    nothing = distances_to_scan(cloud_of(np.empty((0, 3))), frame)
    assert len(nothing.accuracy_m) == len(nothing.completeness_m) == 0
    with pytest.raises(ReferenceMissing):
        distances_to_scan(cloud_of(SCANNED), replace(frame, scan=None))
    with pytest.raises(StructureError, match="camera_left"):
        distances_to_scan(replace(cloud_of(SCANNED), frame="velodyne"), frame)
