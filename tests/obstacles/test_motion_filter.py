"""The filter: laws of motion, the usual equations, and an error that does not average out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pseudolidar.obstacles.motion_filter import (
    ASIDE,
    LASTING,
    PLACE,
    RIG,
    SIZE,
    TURN,
    Belief,
    Dynamics,
    Place,
    Straight,
    Turning,
    _moved,
)

STRAIGHT = Dynamics(1.0, Straight(), 3.0)
TURNS = Dynamics(1.0, Turning(), 3.0)


def place(x: float, y: float = 0.0, sigma: float = 0.5, persistent: float = 0.0) -> Place:
    return Place(np.array([x, y, 0.0]), np.eye(3), np.array([sigma, 0.1, 0.1]), (persistent, 0.0))


def moving(turn: float = 0.0) -> Belief:
    rng = np.random.default_rng(0)
    A = rng.standard_normal((SIZE, SIZE))
    mean = np.array([1.0, 2.0, 0.5, 6.0, -3.0, 0.2, turn, 0.4, -0.3, 0.0])
    return Belief(mean, 0.1 * A @ A.T)


def test_two_short_steps_are_one_long_one() -> None:
    long = moving().after(0.7, STRAIGHT)
    short = moving().after(0.2, STRAIGHT).after(0.5, STRAIGHT)
    np.testing.assert_allclose(short.mean, long.mean, rtol=1e-12)
    keep = [i for i in range(SIZE) if i != TURN]  # a turn that changes is linear only at once
    still = np.ix_(keep, keep)
    start = moving()
    start.covariance[TURN, :] = start.covariance[:, TURN] = 0.0
    long, short = start.after(0.7, STRAIGHT), start.after(0.2, STRAIGHT).after(0.5, STRAIGHT)
    np.testing.assert_allclose(short.covariance[still], long.covariance[still], rtol=1e-9)


def test_a_quarter_of_a_circle() -> None:
    turn, speed = 0.5, 5.0
    belief = Belief(np.array([0, 0, 0, speed, 0, 0, turn, 0, 0, 0.0]), np.eye(SIZE))
    mean, _ = _moved(belief.mean, math.pi / 2 / turn)
    radius = speed / turn
    np.testing.assert_allclose(mean[:5], [radius, radius, 0, 0, speed], atol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 1e-5, 0.3, -1.2])
def test_the_derivative_is_that_of_the_motion(turn: float) -> None:
    mean = moving(turn).mean
    _, F = _moved(mean, 0.4)
    for index in range(7):
        step = np.zeros(SIZE)
        step[index] = 1e-4
        slope = (_moved(mean + step, 0.4)[0] - _moved(mean - step, 0.4)[0]) / 2e-4
        np.testing.assert_allclose(F[:, index], slope, atol=1e-6)


def test_a_measurement_is_taken_as_the_textbook_does() -> None:
    belief, rng = moving(), np.random.default_rng(1)
    belief.covariance[RIG, :] = belief.covariance[:, RIG] = 0.0  # a perfect rig
    axes, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    seen_at = Place(np.array([1.5, 1.0, 0.7]), axes, np.array([0.8, 0.2, 0.1]), (0.4, 0.7))
    H = np.zeros((3, SIZE))
    H[:, PLACE], H[0, LASTING] = axes, math.sqrt(0.4) * 0.8
    H[1, ASIDE] = math.sqrt(0.7) * 0.2
    R = np.diag([0.6 * 0.8**2, 0.3 * 0.2**2, 0.1**2])
    S = H @ belief.covariance @ H.T + R
    off = axes @ seen_at.xyz - H @ belief.mean
    gain = belief.covariance @ H.T @ np.linalg.inv(S)
    after, distance, log_volume = belief.seen(seen_at)
    np.testing.assert_allclose(after.mean, belief.mean + gain @ off, rtol=1e-9)
    np.testing.assert_allclose(
        after.covariance, (np.eye(SIZE) - gain @ H) @ belief.covariance, atol=1e-9
    )
    assert distance == pytest.approx(off @ np.linalg.inv(S) @ off)
    assert log_volume == pytest.approx(math.log(np.linalg.det(S)))


def test_an_error_that_stays_does_not_average_out() -> None:
    def sigma_m(persistent: float) -> float:
        still = Dynamics(1e-3, Straight(), 1e6)
        belief = Belief.begun(place(30.0, persistent=persistent), 1e-3, Straight())
        for _ in range(100):
            belief = belief.after(0.1, still).seen(place(30.0, persistent=persistent))[0]
        return math.sqrt(belief.covariance[0, 0])

    assert sigma_m(0.0) == pytest.approx(0.05, rel=0.05)  # 0.5 m / sqrt(101)
    assert sigma_m(0.5) == pytest.approx(math.sqrt(0.5) * 0.5, rel=0.02)
    assert sigma_m(1.0) == pytest.approx(0.5, rel=0.01)


def test_a_staying_share_of_the_distance_makes_velocity_less_sure() -> None:
    """What comes nearer with 2 % of its distance too much seems 2 % faster, in every frame."""
    velocities, sigmas = [], []
    for persistent in (0.0, 1.0):
        belief = Belief.begun(place(42.0, sigma=0.02 * 42, persistent=persistent), 12.0, Straight())
        for k in range(1, 40):
            x = 42.0 - k
            seen_at = place(1.02 * x, sigma=0.02 * x, persistent=persistent)
            belief = belief.after(0.1, Dynamics(0.1, Straight(), 1e6)).seen(seen_at)[0]
        velocities.append(belief.mean[3])
        sigmas.append(math.sqrt(belief.covariance[3, 3]))
    assert velocities[0] == pytest.approx(-10.2, abs=0.05)
    assert abs(velocities[0] + 10.0) > 2 * sigmas[0]  # taken as noise, it would be believed
    assert abs(velocities[1] + 10.0) < 1.5 * sigmas[1]


def test_the_error_of_the_rig_is_reckoned_with_and_never_learnt() -> None:
    """Drawn: a rig that is off by a share of the square of the distance, in every frame."""
    rng, errors, sigmas = np.random.default_rng(0), [], []
    for _ in range(60):
        rig = rng.standard_normal()
        belief = None
        for k in range(25):
            x = 40.0 - k
            shared_m = 1e-3 * x**2
            measured = x + shared_m * rig + 0.1 * rng.standard_normal()
            at = Place(np.array([measured, 0.0, 0.0]), np.eye(3), np.full(3, 0.1), (0, 0), shared_m)
            if belief is None:
                belief = Belief.begun(at, 12.0, Straight())
            else:
                belief = belief.after(0.1, Dynamics(0.1, Straight(), 3.0)).seen(at)[0]
        assert belief is not None
        assert belief.mean[RIG] == 0.0
        assert belief.covariance[RIG, RIG] == pytest.approx(1.0)
        errors.append([belief.mean[0] - 16.0, belief.mean[3] + 10.0])
        sigmas.append(np.sqrt(np.diag(belief.covariance)[[0, 3]]))
    normalised = np.mean((np.array(errors) / np.array(sigmas)) ** 2, axis=0)
    assert ((normalised > 0.5) & (normalised < 1.6)).all()


def test_a_measurement_far_off_is_doubted_and_a_near_one_is_not() -> None:
    belief = Belief.begun(place(30.0), 1.0, Straight())
    near, far = place(30.3), place(34.0)  # its own sigma is 0.5 m, that of the belief too
    doubted = belief.seen_with_doubt(near, 5)
    np.testing.assert_array_equal(doubted.mean, belief.seen(near)[0].mean)
    assert belief.seen(far)[0].mean[0] == pytest.approx(32.0)
    # of what was often seen the measurement is to blame, of what was seen once either is
    often, once = (belief.seen_with_doubt(far, seen) for seen in (20, 1))
    assert 30.0 < often.mean[0] < 31.0
    assert 31.0 < once.mean[0] < 33.0
    assert often.covariance[0, 0] > belief.seen(far)[0].covariance[0, 0]


def test_a_jump_is_no_motion() -> None:
    """Seen 20 m too near for three frames, a thing that stands has not come back at 200 m/s."""
    belief = Belief.begun(place(30.0), 8.0, Straight())
    for x in (30.0, 30.0, 50.0, 50.0, 50.0, 50.0, 50.0, 50.0):
        belief = belief.after(0.1, STRAIGHT).seen_with_doubt(place(x), 3)
    assert abs(belief.mean[3]) < 8.0
    assert belief.mean[0] > 45.0
