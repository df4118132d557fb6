"""How unsure poses are that nothing was measured of: as far off as they turn out to be."""

import numpy as np
import pytest

from pseudolidar.errors import StructureError
from pseudolidar.geometry.pose_doubt import unsure_m
from pseudolidar.geometry.twists import carried, exp_twist, inverted, log_twist
from pseudolidar.mapping.bridges import bridged
from pseudolidar.mapping.extrapolating import FARTHEST_M, ExtrapolatingChain
from pseudolidar.mapping.path import stacked
from pseudolidar.mapping.steadiness import MOST_GUESSED_M, Steadiness
from pseudolidar.structures.pose import Trajectory
from tests.mapping.told_chain import STEP_DOUBT, UNKNOWN, ToldChain, frames_for, going

TRIALS, STEP_S = 800, 0.1
# Ahead at 8 m/s in a sharp turn; a pose of which the direction is known to 1 degree.
TWIST_PER_S = np.array([1.0, 0.0, 8.0, 0.1, 1.0, 0.0])
KNOWN = np.diag(np.array([0.01, 0.02, 0.01, 0.02, 0.02, 0.02]) ** 2)
STEP = np.diag(np.array([0.01, 0.004, 0.01, 0.002, 0.002, 0.002]) ** 2)
# One standard deviation of accelerations, m/s2 and rad/s2.
NO, SOME = np.zeros(6), np.array([1.0, 0.3, 2.0, 0.1, 0.2, 0.1])


def noise(rng, covariance):
    return rng.multivariate_normal(np.zeros(6), covariance, TRIALS)


def nees(estimates, truth, covariance):
    """Mean of normalised squared errors by their dimensions: 1 is exact."""
    errors = [log_twist(inverted(T) @ exact) for T, exact in zip(estimates, truth, strict=True)]
    return np.mean([e @ np.linalg.solve(covariance, e) / 6 for e in errors])


@pytest.mark.parametrize("acceleration", [NO, SOME], ids=["steady", "accelerating"])
@pytest.mark.parametrize("ahead_s", [0.1, 0.5])
def test_who_goes_on_is_as_far_off_as_it_says(acceleration, ahead_s):
    rng, estimates, truth = np.random.default_rng(0), [], []
    moved = rng.normal(size=(TRIALS, 6)) * acceleration
    for a, before, wrong in zip(moved, noise(rng, KNOWN), noise(rng, STEP), strict=True):
        step = exp_twist(STEP_S * (TWIST_PER_S + 0.5 * STEP_S * a))
        on = exp_twist(ahead_s * (TWIST_PER_S + (STEP_S + 0.5 * ahead_s) * a))
        seen = step @ exp_twist(wrong)
        going_on = exp_twist(ahead_s / STEP_S * log_twist(seen))
        estimates.append(exp_twist(before) @ seen @ going_on)
        truth.append(step @ on)
    known = carried(KNOWN, exp_twist(STEP_S * TWIST_PER_S)) + STEP
    doubt = Steadiness(acceleration**2, 1).gone_on(known, STEP, TWIST_PER_S, STEP_S, ahead_s)
    assert 0.9 < nees(estimates, truth, doubt.total) < 1.1


@pytest.mark.parametrize("acceleration", [NO, SOME], ids=["steady", "accelerating"])
@pytest.mark.parametrize("share", [0.2, 0.7])
def test_a_pose_between_is_as_far_off_as_it_says(acceleration, share):
    gap_s, rng, estimates, truth = 0.6, np.random.default_rng(1), [], []
    at_s = share * gap_s
    moved = rng.normal(size=(TRIALS, 6)) * acceleration
    for a, before, wrong in zip(moved, noise(rng, KNOWN), noise(rng, STEP), strict=True):
        step = exp_twist(gap_s * (TWIST_PER_S + 0.5 * gap_s * a))
        seen = share * log_twist(step @ exp_twist(wrong))
        estimates.append(exp_twist(before) @ exp_twist(seen))
        truth.append(exp_twist(at_s * (TWIST_PER_S + 0.5 * at_s * a)))
    T_first = exp_twist(at_s * TWIST_PER_S)
    doubt = Steadiness(acceleration**2, 1).between(KNOWN, STEP, T_first, gap_s, at_s)
    assert 0.9 < nees(estimates, truth, doubt.total) < 1.1


def test_who_moves_steadily_is_extrapolated_more_surely():
    calm, wild = Steadiness(), Steadiness()
    there, back = np.array([0.0, 0, 8, 0, 0, 0]), np.array([1.0, 0, 5, 0, 1, 0])
    for _ in range(20):
        calm = calm.after(there, there, 0.1)
        wild = wild.after(there, back, 0.1)
    assert (calm.variance < 0.2 * Steadiness().variance).all()
    assert wild.variance[2] > 100 * calm.variance[2]
    step = 1e-6 * np.eye(6)
    sooner, later = (calm.gone_on(step, step, there, 0.1, s).total for s in (0.1, 0.5))
    assert np.linalg.eigvalsh(later - sooner)[0] > 0


def told(states, *, reach=5, dt_s=0.1):
    chain = ExtrapolatingChain(ToldChain(states), reach=reach)
    return [
        chain.register(frame, UNKNOWN).state
        for frame, _ in zip(frames_for(states, dt_s=dt_s), states, strict=True)
    ]


def test_a_path_that_has_drifted_for_long_is_extrapolated_all_the_same():
    ahead = [0.0, 0, 8, 0, 0, 0]
    told_now = told(going(ahead, "foooxxo", doubt=4 * np.eye(6)))
    assert [one.status for one in told_now[4:6]] == ["extrapolated"] * 2
    assert unsure_m(told_now[5].covariance) > 2


def test_so_is_it_bridged():
    step = exp_twist(np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0]))
    poses, doubts = [np.eye(4)], [4 * np.eye(6)]
    for _ in range(5):
        poses.append(poses[-1] @ step)
        doubts.append(carried(doubts[-1], step) + STEP_DOUBT)
    keep = [0, 1, 2, 4, 5]
    times = np.arange(6, dtype=np.int64) * 10**8
    path = stacked(times[keep], [poses[i] for i in keep], [doubts[i] for i in keep])
    whole = bridged(path, times[3:4])
    assert whole.extrapolated.tolist() == [i == 3 for i in range(6)]
    assert np.allclose(whole.T_world_body, poses)


def test_nobody_goes_on_farther_than_25_m_however_steadily():
    fast = told(going([0.0, 0, 30, 0, 0, 0], "f" + 100 * "o" + "xxx", dt_s=0.5), dt_s=0.5)
    assert [one.status for one in fast[-3:]] == ["extrapolated", "lost", "lost"]
    last, on = (fast[i].T_odom_camera.translation_m for i in (-4, -3))
    assert np.linalg.norm(on - last) < FARTHEST_M


def test_nor_until_it_may_be_anywhere():
    slow = told(going([0.0, 0, 1, 0, 0, 0], "foo" + 20 * "x"), reach=30)
    known = [one for one in slow if one.status == "extrapolated"]
    assert 5 <= len(known) <= 12  # 2 m/s2 make a metre in a second
    assert slow[-1].status == "lost"
    assert slow[-1].ended is None
    sigmas = [unsure_m(one.covariance) for one in known]
    assert np.all(np.diff(sigmas) > 0)
    assert 0.7 < sigmas[-1] / MOST_GUESSED_M < 1.1


def test_steadiness_is_learned_on_the_way():
    shortly, long = (
        told(going([0.0, 0, 8, 0, 0, 0], "f" + n * "o" + "xxx"))[-1].covariance for n in (2, 40)
    )
    assert unsure_m(long) < 0.4 * unsure_m(shortly)


def test_and_from_the_whole_path_where_it_is_bridged():
    sigmas = []
    for n in (3, 40):
        poses = [exp_twist(np.array([0.0, 0, 0.8 * i, 0, 0, 0])) for i in range(n)]
        times = np.arange(n, dtype=np.int64) * 10**8
        keep = np.r_[0 : n - 2, n - 1]
        path = stacked(times[keep], np.stack(poses)[keep], np.zeros((n - 1, 6, 6)))
        sigmas.append(unsure_m(bridged(path, times[n - 2 : n - 1]).covariance[n - 2]))
    assert sigmas[1] < 0.4 * sigmas[0]


def test_a_path_that_nobody_knows_the_doubt_of_is_refused():
    bare = Trajectory(np.array([1, 3], np.int64), np.stack([np.eye(4)] * 2))
    with pytest.raises(StructureError, match="without covariance"):
        bridged(bare, np.array([2], np.int64))
