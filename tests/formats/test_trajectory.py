"""KITTI pose files: rigid rows only, and the way from camera 0 to the body and back."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import PoseFileError
from pseudolidar.formats.trajectory import (
    body_poses,
    camera_poses,
    read_kitti_poses,
    write_kitti_poses,
)
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.structures.pose import Pose

STILL = "1 0 0 0 0 1 0 0 0 0 1 0"
BODY = Pose.from_rotation("base_link", "camera_0", R_BODY_OPTICAL, np.array([1.0, 0.2, -0.3]))


@pytest.mark.parametrize(
    ("row", "where", "got"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1", "line 2", "11 numbers"),
        ("1 0 0 nan 0 1 0 0 0 0 1 0", "line 2, column 7", "'nan'"),
        ("1 0 0 0 0 1 0 0 0 0 1.01 0", "line 2", "pose 1 of 2 is not rigid"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0", "line 2", "pose 1 of 2 is not rigid"),
    ],
)
def test_bad_row_is_named(tmp_path, row, where, got):
    path = tmp_path / "06.txt"
    path.write_text(f"{STILL}\n{row}\n")
    with pytest.raises(PoseFileError) as caught:
        read_kitti_poses(path)
    assert caught.value.where == where
    assert got in caught.value.got


def test_forward_in_the_camera_is_forward_in_the_body():
    forward = np.eye(4)
    forward[:3, 3] = (0.0, -0.5, 2.0)  # half a metre up, two along the optical axis
    (pose,) = body_poses(forward[None], BODY)
    np.testing.assert_allclose(pose.translation_m, (2.0, 0.0, 0.5), atol=1e-12)
    assert (pose.dst, pose.src) == ("map", "base_link")


def test_left_turn_of_the_camera_is_a_left_turn_of_the_body():
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.eye(4)
    turn[:3, :3] = [[c, 0, -s], [0, 1, 0], [s, 0, c]]  # about camera -y, which is up
    (pose,) = body_poses(turn[None], BODY)
    np.testing.assert_allclose(pose.matrix[:3, 0], (c, s, 0), atol=1e-12)


def test_round_trips(tmp_path):
    rng = np.random.default_rng(5)
    rotations = np.linalg.qr(rng.normal(size=(6, 3, 3)))[0]
    rotations *= np.sign(np.linalg.det(rotations))[:, None, None]
    matrices = np.tile(np.eye(4), (6, 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotations, rng.normal(size=(6, 3)) * 100
    write_kitti_poses(tmp_path / "00.txt", matrices)
    np.testing.assert_array_equal(read_kitti_poses(tmp_path / "00.txt"), matrices)
    again = camera_poses(body_poses(matrices, BODY), BODY)
    np.testing.assert_allclose(again, matrices, atol=1e-12)


@pytest.mark.real
def test_real_path_is_59_9_m(real_data):
    poses = read_kitti_poses(real_data / "kitti_odometry" / "poses" / "06.txt")
    steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert len(poses) == 51
    assert steps_m.sum() == pytest.approx(59.9, abs=0.05)
