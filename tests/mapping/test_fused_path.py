"""Paths of fused odometry, put right when more is known of vision's steps."""

import numpy as np
import pytest

from pseudolidar.geometry.twists import exp_twist, inverted
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.mapping.fused_path import FusedPath, FusedStep, VisionPart, step_between
from pseudolidar.structures.pose import Trajectory, rotation_error

STEP = exp_twist(np.array([0.02, 0.0, 1.0, 0.0, 0.03, 0.0]))
STRETCHED = exp_twist(np.array([0.02, 0.0, 1.01, 0.0, 0.03, 0.0]))
BY_OFFSET = np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])
COVARIANCE = np.diag([1e-4] * 3 + [1e-8] * 3)


def chained(steps):
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def path(gains):
    one = FusedPath(10)
    for at, gain in enumerate(gains):
        part = gain * np.eye(6)
        one.add(11 + at, seen_step(STEP, at, part))
    return one


def seen_step(T, at, gain):
    vision = VisionPart(0, at, at + 1, STEP, gain)
    return FusedStep(T, COVARIANCE, gain @ BY_OFFSET, vision)


@pytest.mark.parametrize(("gain", "longer_m"), [(1.0, 0.01), (0.0, 0.0), (0.5, 0.005)])
def test_steps_follow_vision_by_their_gain(gain, longer_m):
    vision = Trajectory(np.arange(10, 13), chained([STRETCHED] * 2))
    settled = path([gain, gain]).settled([vision], Offset(0.3, 0.1))
    assert settled.timestamps_ns.tolist() == [10, 11, 12]
    for before, after in zip(settled.T_world_body[:-1], settled.T_world_body[1:], strict=True):
        longer = (inverted(before) @ after)[2, 3] - STEP[2, 3]
        assert longer == pytest.approx(longer_m, abs=1e-4)


def test_nothing_moves_where_vision_says_what_it_said():
    one = path([1.0, 0.4, 0.0])
    settled = one.settled([Trajectory(np.arange(10, 14), chained([STEP] * 3))], Offset())
    assert np.allclose(settled.T_world_body[-1], one.last.T_odom_camera)
    assert np.allclose(settled.covariance[-1], one.last.doubt.total(Offset()))


def test_the_offset_is_one_error_of_all_steps():
    still = Trajectory(np.arange(10, 15), chained([STEP] * 4))
    known, unknown = (
        path([1.0] * 4).settled([still], Offset(0.0, sigma)).covariance[-1] for sigma in (0.0, 1.0)
    )
    # four steps of 0.02 m/px are 0.08 m, not twice 0.02 m
    assert np.sqrt(unknown[2, 2] - known[2, 2]) == pytest.approx(0.08, rel=0.02)


def test_poses_stay_rigid_over_many_steps():
    one = FusedPath(0)
    for at in range(200):
        # a step as it is found: between poses of the map
        found = one.last.T_odom_camera @ STEP
        T = inverted(one.last.T_odom_camera) @ found
        one.add(at + 1, seen_step(T, at, np.eye(6)))
    assert rotation_error(one.last.T_odom_camera[:3, :3]) < 1e-12


def test_scans_between_two_frames_of_vision_are_a_branch():
    one = FusedPath(10)
    one.add(11, seen_step(STEP, 0, np.eye(6)))
    seen = one.last
    unsure = FusedStep(STEP, 9 * COVARIANCE, np.zeros(6))
    for at in (12, 13):
        one.add(at, unsure)
    last = one.last
    far = STEP @ STEP @ STEP
    back = FusedStep(far, COVARIANCE, np.zeros(6), VisionPart(0, 1, 2, far, np.eye(6)))
    now = one.add(14, back, seen)
    # As sure as vision's own step, whatever scans did meanwhile.
    assert np.allclose(now.doubt.covariance[3:, 3:], 2 * COVARIANCE[3:, 3:])
    T, doubt = step_between(last, seen, now, back)
    assert np.allclose(T, STEP)
    assert np.allclose(doubt[3:, 3:], 19 * COVARIANCE[3:, 3:])
    vision = Trajectory(np.array([10, 11, 14]), chained([STEP, STRETCHED @ STRETCHED @ STRETCHED]))
    poses = one.settled([vision], Offset()).T_world_body
    ways = [(inverted(poses[1]) @ pose)[2, 3] for pose in poses[2:]]
    assert ways == pytest.approx([(chained([STEP] * 2)[i])[2, 3] for i in (1, 2)] + [ways[2]])
    assert ways[2] == pytest.approx((STRETCHED @ STRETCHED @ STRETCHED)[2, 3])
