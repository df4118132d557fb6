"""Loops closed on a path whose truth is known, without pictures."""

import itertools

import numpy as np
import pytest

from pseudolidar.errors import PoseMissing
from pseudolidar.geometry.twists import exp_twist, inverted
from pseudolidar.mapping.pose_graph import closed
from pseudolidar.sources.worlds.block import ROUND_M, Block
from pseudolidar.structures.loop import LoopClosure, LoopEnd
from pseudolidar.structures.pose import Trajectory

STEP_M, ROUND = 2.0, int(ROUND_M / 2)
N = 2 * ROUND


def exact() -> np.ndarray:
    """(N, 4, 4) twice round the block, in the first pose."""
    block = Block()
    T = np.stack([block.T_world_base(i * STEP_M / block.speed_m_s) for i in range(N)])
    return inverted(T[0]) @ T


def drifting(T: np.ndarray, turn_deg: float = 0.03) -> np.ndarray:
    """The path with each step turned by a little, and a little wrong."""
    rng, path = np.random.default_rng(0), [np.eye(4)]
    for before, after in itertools.pairwise(T):
        wrong = np.concatenate([rng.normal(0, 0.004, 3), np.deg2rad([0.005, 0.005, turn_deg])])
        path.append(path[-1] @ inverted(before) @ after @ exp_twist(wrong))
    return np.stack(path)


def loop(T: np.ndarray, earlier: int, later: int, *, wrong=None, pieces=(0, 0)) -> LoopClosure:
    rng = np.random.default_rng([earlier, later])
    error = rng.normal(0, 1, 6) * np.repeat([0.02, 0.001], 3)
    measured = inverted(T[earlier]) @ T[later] @ exp_twist(error if wrong is None else wrong)
    points = np.zeros((40, 2), np.float32)
    return LoopClosure(
        LoopEnd(earlier, 10 + earlier, pieces[0]),
        LoopEnd(later, 10 + later, pieces[1]),
        measured,
        np.diag(np.repeat([0.02**2, 0.001**2], 3)),
        points,
        points,
        np.zeros(40),
        matches=50,
        overlap=0.9,
        both_ways_m=0.0,
        both_ways_deg=0.0,
        correction_m=0.0,
        correction_deg=0.0,
    )


def trajectory(T: np.ndarray, start: int = 0) -> Trajectory:
    return Trajectory(10 + start + np.arange(len(T)), T)


def off_m(T: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.linalg.norm(T[:, :3, 3] - truth[:, :3, 3], axis=1)


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return exact()


@pytest.fixture(scope="module")
def loops(truth) -> list[LoopClosure]:
    return [loop(truth, i, i + ROUND) for i in range(4, ROUND - 4, 12)]


def test_drift_of_metres_is_closed(truth, loops):
    drift = drifting(truth)
    assert off_m(drift, truth)[-1] > 2.0
    path = closed([trajectory(drift)], loops)
    (T,) = (one.T_world_body for one in path.trajectories)
    assert path.used == tuple(loops)
    assert off_m(T, truth)[-1] < 0.2
    assert off_m(T, truth).max() < 0.25 * off_m(drift, truth).max()
    assert np.allclose(T[0], np.eye(4))
    assert np.allclose(T[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2), np.eye(3), atol=1e-9)
    gaps = [inverted(T[i]) @ T[i + ROUND] for i in range(4, ROUND - 8)]
    exact_gaps = [inverted(truth[i]) @ truth[i + ROUND] for i in range(4, ROUND - 8)]
    assert off_m(np.stack(gaps), np.stack(exact_gaps)).max() < 0.2


def test_false_loops_are_dropped(truth, loops):
    false = [
        loop(truth, 40, 200, wrong=np.array([4.0, 0, 3.0, 0, 0.1, 0])),
        loop(truth, 20, 90, wrong=np.array([8.0, 0, 3.0, 0, 0.3, 0])),
    ]
    path = closed([trajectory(drifting(truth))], [*loops, *false])
    assert path.dropped == tuple(false)
    assert off_m(path.trajectories[0].T_world_body, truth)[-1] < 0.2


def test_loops_join_pieces(truth):
    cut, drift = 150, drifting(truth, turn_deg=0.005)
    first, second = drift[:cut], inverted(drift[cut]) @ drift[cut:]
    joining = [
        loop(truth, i, i + ROUND, pieces=(0, int(i + ROUND >= cut))) for i in range(4, 120, 10)
    ]
    apart = Trajectory(np.arange(1000, 1003), np.tile(np.eye(4), (3, 1, 1)))
    path = closed([trajectory(first), trajectory(second, cut), apart], joining)
    assert path.maps == (0, 0, 1)
    T = np.concatenate([one.T_world_body for one in path.trajectories[:2]])
    assert off_m(T, truth)[-20:].max() < 1.0  # as far as the first piece drifts, which is held
    assert np.array_equal(path.trajectories[2].T_world_body, apart.T_world_body)


def test_of_very_many_loops_some_are_solved(truth, loops, monkeypatch):
    monkeypatch.setattr("pseudolidar.mapping.pose_graph.MOST_LOOPS", 4)
    path = closed([trajectory(drifting(truth))], loops)
    assert path.used == tuple(loops[::3])
    assert off_m(path.trajectories[0].T_world_body, truth)[-1] < 0.4


def test_without_loops_nothing_moves(truth):
    path = closed([trajectory(truth)], [])
    assert path.trajectories[0].T_world_body is truth
    assert path.maps == (0,)


def test_a_loop_of_unknown_frames_is_refused(truth):
    with pytest.raises(PoseMissing, match="frame 200"):
        closed([trajectory(truth[:150])], [loop(truth, 10, 200)])
