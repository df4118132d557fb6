"""The offset that motion tells while driving, and what it does to paths."""

import numpy as np
import pytest

from pseudolidar.geometry.pnp import refined_pose
from pseudolidar.geometry.tracking import Seeds
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.disparity_offset import Offset, OffsetEstimate, by_offset, unscaled
from pseudolidar.mapping.path import Doubt, Hung, Path
from pseudolidar.mapping.registration import covariance, offsets_px
from tests.moving_rig import STEP, motions_of, rig, tracks

MOTIONS = 10


def found(estimate, of, T, points):
    """A motion as odometry finds it, with what is known by now taken off."""
    correction = estimate.now.correction(of)
    return refined_pose(T, points, of, offset_px=offsets_px(points, of, correction))


def followed(planted_px, *, doffs_px=0.0, noise_px=0.2):
    of = rig(doffs_px=doffs_px)
    estimate, told = OffsetEstimate(of), []
    for T, points in motions_of(of, MOTIONS, offset_px=planted_px, noise_px=noise_px):
        seeds = Seeds(points.uv_from.astype(np.float32), points.d_from)
        estimate.add(found(estimate, of, T, points), seeds)
        told.append(estimate.now)
    return of, told


@pytest.mark.parametrize(("planted_px", "doffs_px"), [(-0.6, 0.0), (0.4, 31.0)])
def test_a_planted_offset_is_found_while_driving(planted_px, doffs_px):
    of, told = followed(planted_px, doffs_px=doffs_px)
    assert abs(told[-1].offset_px - planted_px) < 2 * told[-1].sigma_px
    assert told[-1].sigma_px < told[0].sigma_px < 1
    # near depths stay where they are: farther ones are made longer, or shorter, with them
    correction = told[-1].correction(of)
    near = np.array([rig().fB_px_m / 6.0 - doffs_px])
    middle = np.array([of.left.K[0, 2]])
    moved_px = correction.offset_px(near, middle, middle * 0, of.left.size_px)
    far_px = correction.offset_px(np.array([5.0 - doffs_px]), middle, middle * 0, of.left.size_px)
    assert abs(moved_px[0]) < 0.4 * abs(planted_px)
    assert far_px[0] == pytest.approx(planted_px, abs=0.2 * abs(planted_px))


def test_where_there_is_none_nothing_is_corrected():
    of, told = followed(0.0)
    assert all(abs(one.offset_px) < 0.02 for one in told)
    assert Offset().correction(of) is None


def test_poses_follow_an_offset_that_is_known_later():
    of = rig()
    points = tracks(of, exp_twist(STEP), offset_px=-0.5, noise_px=0.1)
    early, late = Offset(-0.2, 0.1, -0.02), Offset(-0.5, 0.1, -0.02)
    solved = {}
    for offset in (early, late):
        correction = offset.correction(of)
        solved[offset] = refined_pose(
            exp_twist(STEP), points, of, offset_px=offsets_px(points, of, correction)
        )
    motion = solved[early]
    shift = by_offset(unscaled(motion, early), of, early)
    hung = Hung.of(motion.T_to_from, covariance(motion), shift, early)
    want = inverted(solved[late].T_to_from)
    moved = log_twist(inverted(hung.T_key_frame) @ want)
    left = log_twist(inverted(hung.with_offset(late)) @ want)
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(moved)
    assert np.allclose(hung.with_offset(early), hung.T_key_frame)
    # the stored derivative says the same
    assert np.allclose(hung.by_offset * -0.3, moved, atol=0.1 * np.linalg.norm(moved))
    path = Path()
    path.add_key(Hung.itself(early))
    path.add_frame(1, Hung.itself(early))
    path.add_key(hung)
    path.add_frame(2, Hung.itself(early))
    assert np.allclose(path.trajectory(late).T_world_body[1], hung.with_offset(late))


def test_doubt_of_an_offset_adds_up_in_one_direction():
    hung = Hung(
        exp_twist(-STEP), 1e-4 * np.eye(6), np.array([0, 0, 0.02, 0, 0, 0]), Offset(), np.zeros(6)
    )
    doubt = Doubt.none()
    for _ in range(9):
        doubt = doubt.after(hung)
    known, unknown = (doubt.total(Offset(sigma_px=sigma)) for sigma in (0.0, 1.0))
    # nine steps of 0.02 m/px are 0.18 m, not 3 times 0.02 m
    assert np.sqrt(unknown[2, 2] - known[2, 2]) == pytest.approx(0.18, rel=0.02)
    assert known[0, 0] > 9e-4
