import numpy as np
import pytest

from pseudolidar.errors import CalibrationField
from pseudolidar.geometry.cloud_frames import default_frame, forward_frame, left_in
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.structures.camera import Camera, StereoRig
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
