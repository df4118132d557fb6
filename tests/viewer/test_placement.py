"""Poses of the scene, the map and the rig: what is said of one holds for the others."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.twists import exp_twist
from pseudolidar.viewer.placement import Placement, moved

UTM_M = np.array([4.5e5, 5.4e6, 110.0])
THING_M = np.array([10.0, -2.0, 0.5])


def pose(x: float, yaw_rad: float) -> np.ndarray:
    T = exp_twist(np.array([0, 0, 0, 0, 0, yaw_rad]))
    T[:3, 3] = UTM_M + np.array([x, 0, 0])
    return T


def test_to_follow_the_rig_is_to_move_the_map():
    placement = Placement()
    for T in (pose(0, 0.1), pose(5, 0.4)):
        placement.move(T, None)
        np.testing.assert_allclose(placement.T_scene_rig, np.eye(4), atol=1e-9)
        np.testing.assert_allclose(placement.origin_m, UTM_M)
        # a place of the map is where the rig sees it
        seen = np.linalg.inv(T) @ np.append(UTM_M + THING_M, 1)
        np.testing.assert_allclose(moved(placement.T_scene_map, UTM_M + THING_M), seen[:3])
    placement.follow = False
    placement.move(pose(5, 0.4), None)
    np.testing.assert_allclose(placement.T_scene_rig[:3, 3], (5, 0, 0))


def test_what_is_held_stays_until_it_is_let_go():
    placement = Placement()
    placement.move(pose(0, 0), THING_M)
    assert placement.holds
    placement.move(pose(3, 0), THING_M + np.array([1.0, 0, 0]))
    np.testing.assert_allclose(placement.of_rig(THING_M + np.array([1.0, 0, 0])), THING_M)
    placement.move(pose(4, 0), None)  # not seen: nothing jumps
    np.testing.assert_allclose(placement.T_scene_rig[:3, 3], (-1, 0, 0))
    placement.let_go()
    placement.move(pose(5, 0), None)
    assert not placement.holds
    np.testing.assert_allclose(placement.T_scene_rig, np.eye(4), atol=1e-12)


def test_frames_without_a_pose_are_at_the_origin():
    placement = Placement()
    placement.settle(UTM_M)
    placement.move(None, None)
    np.testing.assert_array_equal(placement.T_scene_rig, np.eye(4))
    np.testing.assert_array_equal(placement.origin_m, UTM_M)
