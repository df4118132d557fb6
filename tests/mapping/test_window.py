"""Poses made to agree with motions between them, some of which are wrong."""

import numpy as np

from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.window import Edge, agreed

N = 6
SIGMA = np.array([0.02, 0.02, 0.02, 0.002, 0.002, 0.002])
STEP = np.array([0.05, -0.02, 1.2, 0.01, 0.03, -0.005])


def path():
    T = [np.eye(4)]
    for _ in range(N - 1):
        T.append(T[-1] @ exp_twist(STEP))
    return np.stack(T)


def measured(truth, rng, *, reach=2):
    return [
        Edge(
            i,
            j,
            inverted(truth[i]) @ truth[j] @ exp_twist(rng.normal(0, SIGMA)),
            np.diag(SIGMA**2),
        )
        for i in range(N)
        for j in range(i + 1, min(i + reach + 1, N))
    ]


def chained(edges):
    T = [np.eye(4)]
    for edge in edges:
        if edge.second == edge.first + 1:
            T.append(T[-1] @ edge.T_first_second)
    return np.stack(T)


def end_error(T, truth):
    return log_twist(inverted(truth[-1]) @ T[-1])


def test_exact_motions_give_the_path_from_anywhere():
    truth = path()
    edges = [
        Edge(e.first, e.second, inverted(truth[e.first]) @ truth[e.second], e.covariance)
        for e in measured(truth, np.random.default_rng(0))
    ]
    start = np.stack([T @ exp_twist(0.02 * np.ones(6) * (i > 0)) for i, T in enumerate(truth)])
    assert np.allclose(agreed(start, edges), truth, atol=1e-6)


def test_motions_across_make_paths_better():
    truth, before, after = path(), [], []
    for seed in range(40):
        edges = measured(truth, np.random.default_rng(seed))
        start = chained(edges)
        before.append(end_error(start, truth))
        after.append(end_error(agreed(start, edges), truth))
    ratio = np.std(after, axis=0) / np.std(before, axis=0)
    assert np.all(ratio[2:] < 0.95)  # along the path and in rotation: more was measured


def test_a_wrong_motion_across_is_not_followed():
    truth = path()
    edges = measured(truth, np.random.default_rng(1))
    right = agreed(chained(edges), edges)
    wrong = [
        Edge(e.first, e.second, e.T_first_second @ exp_twist(np.full(6, 0.3)), e.covariance)
        if (e.first, e.second) == (1, 3)
        else e
        for e in edges
    ]
    assert np.abs(log_twist(inverted(right[-1]) @ agreed(chained(wrong), wrong)[-1])).max() < 0.03
