"""The kernels of the footprint against the same in numpy, all rectangles at once."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.obstacles.footprint_kernels import (
    BENT,
    MISSED,
    STEP,
    best_rectangle,
    descend,
    jacobian_of,
    residuals_of,
)

USUAL = np.array([3.9, 0.45, 1.65, 0.12])
EDGES = np.array([-0.1, 0.12, 0.003])
SHARE = 2.0


def sight(seed: int, count: int = 20) -> np.ndarray:
    """(3, B) directions with the depths of something uneven at about 14 m."""
    rng = np.random.default_rng(seed)
    depth = 14 + np.cumsum(rng.normal(0, 0.2, count))
    return np.stack([np.linspace(-0.1, 0.12, count), depth, rng.uniform(0.05, 0.4, count)])


def residuals_in_numpy(values: np.ndarray, seen: np.ndarray, edges: np.ndarray) -> np.ndarray:
    bearing, depth, sigma = seen
    x, z, heading, length, width = values
    s, c = np.sin(heading), np.cos(heading)
    near, far = np.full(len(bearing), -np.inf), np.full(len(bearing), np.inf)
    for ex, ez, half in ((s, c, 0.5 * length), (c, -s, 0.5 * width)):
        rate = ex * bearing + ez
        middle, reach = (ex * x + ez * z) / rate, half / np.abs(rate)
        near, far = np.maximum(near, middle - reach), np.minimum(far, middle + reach)
    along = (depth - near) / sigma
    along = np.where(near > far, np.hypot(along, MISSED), along) / SHARE
    signs = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    corners = [x, z] + 0.5 * signs * [length, width] @ np.array([[s, c], [c, -s]])
    bearings = corners[:, 0] / corners[:, 1]
    ends = np.array([bearings.min() - edges[0], bearings.max() - edges[1]]) / edges[2]
    sizes = [(length - USUAL[0]) / USUAL[1], (width - USUAL[2]) / USUAL[3]]
    return np.concatenate([along, np.nan_to_num(ends), sizes])


def loss_in_numpy(residuals: np.ndarray) -> float:
    return float((2 * BENT**2 * (np.sqrt(1 + (residuals / BENT) ** 2) - 1)).sum())


@pytest.mark.parametrize("hidden", [(), (0,), (1,), (0, 1)])
def test_residuals_and_their_derivatives_are_those_of_numpy(hidden: tuple[int, ...]) -> None:
    rng, edges = np.random.default_rng(3), EDGES.copy()
    edges[list(hidden)] = np.nan
    for seed in range(20):
        seen = sight(seed)
        values = np.array([0.0, 15.0, 0.0, 3.9, 1.65]) + rng.normal(0, 0.4, 5)
        found, slopes = np.empty(seen.shape[1] + 4), np.empty((5, seen.shape[1] + 4))
        residuals_of(values, seen, SHARE, USUAL, edges, found)
        jacobian_of(values, found, seen, SHARE, USUAL, edges, slopes)
        want = residuals_in_numpy(values, seen, edges)
        np.testing.assert_allclose(found, want, rtol=1e-9, atol=1e-9)
        moved = [residuals_in_numpy(values + STEP * one, seen, edges) for one in np.eye(5)]
        np.testing.assert_allclose(slopes, (moved - want) / STEP, rtol=1e-6, atol=1e-6)


def descent_in_numpy(values: np.ndarray, seen: np.ndarray, rounds: int) -> np.ndarray:
    residuals, damping = residuals_in_numpy(values, seen, EDGES), 1e-3
    for _ in range(rounds):
        moved = [residuals_in_numpy(values + STEP * one, seen, EDGES) for one in np.eye(5)]
        jacobian = (np.array(moved) - residuals).T / STEP
        weighed = jacobian / np.sqrt(1 + (residuals / BENT) ** 2)[:, None]
        hessian = weighed.T @ jacobian
        scaled = hessian + np.diag(damping * np.diag(hessian))
        tried = values + np.clip(-np.linalg.solve(scaled, weighed.T @ residuals), -2, 2)
        tried[3:] = np.maximum(tried[3:], 0.1)
        new = residuals_in_numpy(tried, seen, EDGES)
        better = loss_in_numpy(new) < loss_in_numpy(residuals)
        values, residuals = (tried, new) if better else (values, residuals)
        damping *= 0.3 if better else 10.0
    return values


@pytest.mark.parametrize("heading", [0.2, 0.9, 1.5, 2.6])
def test_a_descent_goes_where_that_of_numpy_goes(heading: float) -> None:
    seen, start = sight(1), np.array([0.1, 15.0, heading, 3.9, 1.65])
    values = start.copy()
    left = descend(values, seen, SHARE, USUAL, EDGES, 12)
    np.testing.assert_allclose(values, descent_in_numpy(start, seen, 12), atol=1e-6)
    assert left == pytest.approx(loss_in_numpy(residuals_in_numpy(values, seen, EDGES)))
    assert left < loss_in_numpy(residuals_in_numpy(start, seen, EDGES))


def test_the_best_of_all_starts_is_taken_and_they_stay_as_they_were() -> None:
    seen = sight(2)
    starts = np.array([[0.1, 15.0, heading, 3.9, 1.65] for heading in (0.0, 0.8, 1.6)])
    before = starts.copy()
    found = best_rectangle(starts, seen, SHARE, USUAL, EDGES, 12)
    left = [descend(one.copy(), seen, SHARE, USUAL, EDGES, 12) for one in starts]
    assert loss_in_numpy(residuals_in_numpy(found, seen, EDGES)) == pytest.approx(min(left))
    np.testing.assert_array_equal(starts, before)
