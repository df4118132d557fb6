from itertools import pairwise

import numpy as np
import pytest

from pseudolidar.errors import CalibrationField
from pseudolidar.geometry.cloud_frames import (
    carried,
    common_frame,
    default_frame,
    forward_frame,
    left_in,
)
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

AHEAD = np.array([[0.0, 0.0, 10.0]])


def rig(*, velodyne):
    camera = Camera(np.array([[700.0, 0, 60], [0, 700, 20], [0, 0, 1]]), 120, 40)
    t_m = np.array([-0.54, 0, 0])
    T_right_left = Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m)
    back = np.array([0.0, 0.0, -0.3])
    T_left_velodyne = Pose.from_rotation("camera_left", "velodyne", R_BODY_OPTICAL.T, back)
    return StereoRig(
        camera, camera, T_right_left, T_left_velodyne=T_left_velodyne if velodyne else None
    )


def test_with_a_velodyne():
    here = rig(velodyne=True)
    assert default_frame(here) == "velodyne"
    assert forward_frame(here, "camera_left") == "velodyne"
    assert np.allclose(left_in(here, "velodyne").apply(AHEAD), [[10.3, 0, 0]])


def test_without_one():
    here = rig(velodyne=False)
    assert default_frame(here) == "camera_left"
    assert forward_frame(here, "camera_left") == "base_link"
    assert np.allclose(left_in(here, "base_link").apply(AHEAD), [[10, 0, 0]])
    assert np.array_equal(left_in(here, "camera_left").apply(AHEAD), AHEAD)
    with pytest.raises(CalibrationField, match="--frame camera_left"):
        left_in(here, "velodyne")


def tied(*names):
    """Each frame stands in the one before it."""
    return tuple(Pose.identity(parent, child) for parent, child in pairwise(names))


@pytest.mark.parametrize(
    ("trees", "found"),
    [
        ([tied("map", "odom", "base", "lidar")] * 2, "map"),
        ([tied("earth", "map", "odom", "lidar")] * 2, "map"),
        ([tied("world", "odom", "lidar"), tied("odom", "lidar")], "odom"),
        ([tied("world", "odom", "lidar")] * 2, "world"),
        ([tied("map", "lidar"), ()], "lidar"),
        ([()], "lidar"),
    ],
)
def test_the_most_fixed_frame_that_all_reach(trees, found):
    assert common_frame([("lidar", tree) for tree in trees]) == found


def test_clouds_that_nothing_ties_together_have_no_frame_in_common():
    assert common_frame([("left", ()), ("right", ())]) is None
    assert common_frame([("a", tied("map", "a")), ("b", tied("map", "b"))]) == "map"


@pytest.mark.parametrize(("far_m", "dtype"), [(4000.0, np.float32), (5_428_123.25, np.float64)])
def test_points_far_from_the_origin_of_their_frame_stay_apart(far_m, dtype):
    cloud = PointCloud(np.array([[0, 0, 0], [0.002, 0, 0]], np.float32), "lidar")
    T = Pose.from_rotation("map", "lidar", np.eye(3), np.array([0, far_m, far_m]))
    moved = carried(cloud, T)
    assert moved.xyz.dtype == dtype
    np.testing.assert_allclose(moved.xyz[1] - moved.xyz[0], [0.002, 0, 0], atol=1e-6)
    turned = Pose.from_rotation("map", "lidar", R_BODY_OPTICAL, np.array([far_m, 0, 0]))
    step = np.abs(np.diff(carried(cloud, turned).xyz.astype(float), axis=0)).sum()
    assert step == pytest.approx(0.002, abs=0.0003)
