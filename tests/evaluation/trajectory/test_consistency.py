"""Errors measured in their own covariances."""

import numpy as np
import pytest

from pseudolidar.evaluation.trajectory.consistency import HIGH, LOW, consistency_of
from pseudolidar.geometry.twists import adjoint, exp_twist, inverted

SIGMA = np.repeat([0.01, 0.002], 3)
STEP = exp_twist(np.array([0.1, 0.0, 0.9, 0.0, 0.05, 0.0]))


def walk(frames, *, times_sigma):
    """A true path, an estimate whose steps err by so many sigmas, and its covariances."""
    rng = np.random.default_rng(1)
    true, own, covariance = [np.eye(4)], [np.eye(4)], [np.zeros((6, 6))]
    for _ in range(frames - 1):
        noise = times_sigma * SIGMA * rng.normal(size=6)
        step = STEP @ exp_twist(noise)
        true.append(true[-1] @ STEP)
        own.append(own[-1] @ step)
        back = adjoint(inverted(step))
        covariance.append(back @ covariance[-1] @ back.T + np.diag(SIGMA**2))
    return np.stack(own), np.stack(covariance), np.stack(true)


@pytest.mark.parametrize("times_sigma", [1.0, 3.0, 0.5])
def test_errors_as_large_as_they_say_are_1(times_sigma):
    own, covariance, true = walk(400, times_sigma=times_sigma)
    told = consistency_of(own, covariance, true)
    assert np.isnan(told.poses[0])
    assert np.isnan(told.steps[0])
    assert np.mean(told.steps[1:]) == pytest.approx(times_sigma**2, rel=0.1)
    if times_sigma == 1.0:
        inside = (told.steps[1:] > LOW) & (told.steps[1:] < HIGH)
        assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
        assert 0.3 < told.medians["poses"] < 3


def test_the_world_of_the_truth_does_not_matter():
    own, covariance, true = walk(5, times_sigma=1.0)
    moved = exp_twist(np.array([5.0, -3.0, 1.0, 0.2, 0.4, 1.0])) @ true
    one, other = (consistency_of(own, covariance, T) for T in (true, moved))
    assert np.allclose(one.poses[1:], other.poses[1:])


def test_a_step_that_no_doubt_came_with_is_not_asked():
    """Its covariance is a difference that cancels in a direction, but for rounding."""
    own, covariance, true = walk(40, times_sigma=1.0)
    turned, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(6, 6)))
    less = (turned * np.concatenate([[-1e-6], SIGMA[1:] ** 2])) @ turned.T
    for i in range(1, len(own)):
        back = adjoint(inverted(inverted(own[i - 1]) @ own[i]))
        covariance[i] = back @ covariance[i - 1] @ back.T + less
    assert np.isnan(consistency_of(own, covariance, true).steps).all()


def test_what_is_surely_right_is_not_asked():
    T = np.stack([np.eye(4), STEP])
    told = consistency_of(T, np.zeros((2, 6, 6)), T)
    assert np.isnan(told.poses).all()
    assert told.medians == {"poses": None, "steps": None}
