"""Poses chain, invert and move points; frames are checked, not trusted."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import StructureError
from pseudolidar.structures.pose import Pose, Trajectory, rotation_error

QUARTER_LEFT = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
T_WORLD_BODY = Pose.from_rotation("world", "body", QUARTER_LEFT, np.array([10.0, 20.0, 0.5]))
T_BODY_CAMERA = Pose.from_rotation("body", "camera", np.eye(3), np.array([1.0, 0.0, 2.0]))


@pytest.mark.parametrize(("kind", "atol"), [(np.float64, 1e-12), (np.float32, 1e-5)])
def test_points_are_turned_then_moved(kind, atol):
    points = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]], kind)
    moved = T_WORLD_BODY.apply(points)
    assert moved.dtype == kind
    np.testing.assert_allclose(moved, [[10, 21, 0.5], [8, 20, 0.5], [10, 20, 3.5]], atol=atol)
    np.testing.assert_array_equal(points[0], (1, 0, 0))
    assert T_WORLD_BODY.apply(points[:0]).shape == (0, 3)


def test_chain_and_inverse():
    T_world_camera = T_WORLD_BODY @ T_BODY_CAMERA
    assert (T_world_camera.dst, T_world_camera.src) == ("world", "camera")
    point = np.array([[0.3, -0.2, 5.0]])
    there = T_world_camera.apply(point)
    np.testing.assert_allclose(there, T_WORLD_BODY.apply(T_BODY_CAMERA.apply(point)))
    T_camera_world = T_world_camera.inverse()
    assert (T_camera_world.dst, T_camera_world.src) == ("camera", "world")
    np.testing.assert_allclose(T_camera_world.apply(there), point, atol=1e-12)


def test_frames_that_do_not_meet_are_refused():
    with pytest.raises(StructureError) as refused:
        T_BODY_CAMERA @ T_WORLD_BODY
    assert "T_body_camera @ T_world_body" in refused.value.got


@pytest.mark.parametrize(
    "R",
    [np.diag([1.0, 1, -1]), 1.01 * np.eye(3), np.full((3, 3), np.nan), np.zeros((3, 3))],
    ids=["mirror", "scale", "NaN", "zero"],
)
def test_what_is_no_rotation_is_refused(R):
    with pytest.raises(StructureError, match="not rigid"):
        Pose.from_rotation("a", "b", R, np.zeros(3))
    assert not rotation_error(R) < 1e-3


def test_last_row_is_checked():
    matrix = np.eye(4)
    matrix[3, 0] = 1.0
    with pytest.raises(StructureError, match="not rigid"):
        Pose("a", "b", matrix)


@pytest.mark.parametrize("stamps_ns", [[5, 5], [5, 4]])
def test_times_of_a_trajectory_increase(stamps_ns):
    poses = np.tile(np.eye(4), (2, 1, 1))
    assert len(Trajectory(np.array([4, 5]), poses)) == 2
    with pytest.raises(StructureError):
        Trajectory(np.array(stamps_ns), poses)
    with pytest.raises(StructureError):
        Trajectory(np.array([1, 2, 3]), poses)
