from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import StructureError
from pseudolidar.geometry.frames import R_BODY_OPTICAL, frame_tree, left_in_base_link
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

K = np.array([[50.0, 0.0, 16.0], [0.0, 50.0, 8.0], [0.0, 0.0, 1.0]])
T_RIGHT_LEFT = Pose.from_rotation(
    "camera_right", "camera_left", np.eye(3), np.array([-0.5, 0.0, 0.0])
)
T_LEFT_VELODYNE = Pose.from_rotation(
    "camera_left", "velodyne", R_BODY_OPTICAL.T, np.array([0.1, -0.2, -0.3])
)
TURN_LEFT = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
T_VELODYNE_IMU = Pose.from_rotation("velodyne", "imu", TURN_LEFT, np.array([-0.8, 0.3, -0.9]))


def rig(**mounted: Pose) -> StereoRig:
    right = Camera(K, 32, 16, frame="camera_right")
    return StereoRig(Camera(K, 32, 16), right, T_RIGHT_LEFT, **mounted)


def in_base_link(tree: tuple[Pose, ...], frame: str) -> Pose:
    return next(pose for pose in tree if (pose.dst, pose.src) == ("base_link", frame))


def test_tree_has_one_root_and_each_child_once() -> None:
    tree = frame_tree(rig(T_left_velodyne=T_LEFT_VELODYNE, T_velodyne_imu=T_VELODYNE_IMU))
    assert [(pose.dst, pose.src) for pose in tree] == [
        ("map", "odom"),
        ("odom", "base_link"),
        ("base_link", "velodyne"),
        ("base_link", "imu"),
        ("base_link", "camera_left"),
        ("base_link", "camera_right"),
    ]


@pytest.mark.parametrize(
    ("mounted", "at_base_link"),
    [
        ({"T_left_velodyne": T_LEFT_VELODYNE, "T_velodyne_imu": T_VELODYNE_IMU}, "imu"),
        ({"T_left_velodyne": T_LEFT_VELODYNE}, "velodyne"),
    ],
)
def test_base_link_is_the_imu_else_the_velodyne(
    mounted: dict[str, Pose], at_base_link: str
) -> None:
    tree = frame_tree(rig(**mounted))
    assert np.array_equal(in_base_link(tree, at_base_link).matrix, np.eye(4))


def test_transforms_agree_with_the_calibration() -> None:
    tree = frame_tree(rig(T_left_velodyne=T_LEFT_VELODYNE, T_velodyne_imu=T_VELODYNE_IMU))
    point_m = np.array([[3.0, 1.0, -0.5]])
    left, velodyne = in_base_link(tree, "camera_left"), in_base_link(tree, "velodyne")
    right = in_base_link(tree, "camera_right")
    through_left = left.apply(T_LEFT_VELODYNE.apply(point_m))
    np.testing.assert_allclose(velodyne.apply(point_m), through_left, atol=1e-12)
    np.testing.assert_allclose(
        right.apply(T_RIGHT_LEFT.apply(T_LEFT_VELODYNE.apply(point_m))), through_left, atol=1e-12
    )
    np.testing.assert_allclose(
        velodyne.matrix @ T_VELODYNE_IMU.matrix, in_base_link(tree, "imu").matrix, atol=1e-12
    )


def test_without_lidar_base_link_is_the_left_camera_turned_forward() -> None:
    T_base_left = left_in_base_link(rig())
    ahead_right_below = T_base_left.apply(np.array([[1.0, 2.0, 10.0]]))
    np.testing.assert_array_equal(ahead_right_below, [[10.0, -1.0, -2.0]])


def test_an_imu_that_nothing_ties_to_the_cameras_is_left_out() -> None:
    tree = frame_tree(rig(T_velodyne_imu=T_VELODYNE_IMU))
    assert {pose.src for pose in tree} == {"odom", "base_link", "camera_left", "camera_right"}


def test_pose_moves_base_link_in_odom() -> None:
    pose = Pose.from_rotation("map", "base_link", TURN_LEFT, np.array([5.0, 6.0, 7.0]))
    tree = {(p.dst, p.src): p.matrix for p in frame_tree(rig(), pose)}
    np.testing.assert_array_equal(tree["map", "odom"] @ tree["odom", "base_link"], pose.matrix)


def test_a_pose_between_other_frames_is_refused() -> None:
    with pytest.raises(StructureError, match="T_map_base_link"):
        frame_tree(rig(), Pose.identity("map", "camera_left"))


def test_two_frames_of_the_same_name_are_refused() -> None:
    T_right_left = Pose("camera_left", "camera_left", T_RIGHT_LEFT.matrix)
    with pytest.raises(StructureError, match="each name once"):
        frame_tree(StereoRig(Camera(K, 32, 16), Camera(K, 32, 16), T_right_left))


def test_quaternions_turn_points_like_their_matrices() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        q = rng.normal(size=4) * rng.choice([1e-9, 1.0], size=4)
        w, x, y, z = q = q / np.linalg.norm(q)
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        found = quaternion_wxyz(R)
        assert found[0] >= 0
        np.testing.assert_allclose(abs(found @ q), 1.0, atol=1e-12)
        np.testing.assert_allclose(np.outer(found, found), np.outer(q, q), atol=1e-8)
