"""A rectangle against the near side of a thing, by Levenberg-Marquardt; import it late.

Numba kernels. A rectangle is (x, z, heading, length, width); what was seen of a thing is given as
flat arrays, so that all of them take the same: `seen` (3, B) bearing, depth and sigma of each
direction, `usual` (4,) mean and sigma of length and of width, `edges` (3,) bearings of the left
and the right edge in the picture (NaN where one is hidden) and their sigma.
"""

from __future__ import annotations

import math

import numpy as np
from numba import float64, njit, types, void

from pseudolidar.structures.arrays import Float64

# Forward differences are taken by so much, m and rad.
STEP = 0.01
SMALLEST_M = 0.1
# Residuals are bent from so many sigmas on; a direction that misses the rectangle is off by this.
BENT, MISSED = 1.5, 3.0
# Damping at the start, and by how much it changes after a step that helps, or does not.
DAMPING, EASED, RAISED = 1e-3, 0.3, 10.0
LONGEST_STEP = 2.0
# A line of sight that is so nearly along a side meets it nowhere.
PARALLEL = 1e-6
SIZE = 5

_VALUES, _MAP = types.Array(float64, 1, "C"), types.Array(float64, 2, "C")
_GIVEN, _SEEN = (types.Array(float64, n, "C", readonly=True) for n in (1, 2))


@njit(
    void(_GIVEN, _SEEN, float64, _GIVEN, _GIVEN, _VALUES),
    nogil=True,
    cache=True,
)
def residuals_of(
    values: Float64,
    seen: Float64,
    share: float,
    usual: Float64,
    edges: Float64,
    out: Float64,
) -> None:
    """(B + 4,) in sigmas, into `out`: depths by direction, both edges, length and width.

    Args:
        values: (5,) rectangle.
        seen: (3, B).
        share: square root of how many directions one independent measurement stands for.
        usual: (4,).
        edges: (3,).
        out: changed.
    """
    x, z, length, width = values[0], values[1], 0.5 * values[3], 0.5 * values[4]
    s, c = math.sin(values[2]), math.cos(values[2])
    along, across = s * x + c * z, c * x - s * z
    count = seen.shape[1]
    for i in range(count):
        near, far = -np.inf, np.inf
        for middle, reach, rate in (
            (along, length, s * seen[0, i] + c),
            (across, width, c * seen[0, i] - s),
        ):
            if abs(rate) < PARALLEL:
                rate = PARALLEL
            near = max(near, middle / rate - reach / abs(rate))
            far = min(far, middle / rate + reach / abs(rate))
        off = (seen[1, i] - near) / seen[2, i]
        out[i] = (math.hypot(off, MISSED) if near > far else off) / share
    left, right = np.inf, -np.inf
    for a in (-length, length):
        for b in (-width, width):
            bearing = (x + a * s + b * c) / max(z + a * c - b * s, SMALLEST_M)
            left, right = min(left, bearing), max(right, bearing)
    out[count] = 0.0 if math.isnan(edges[0]) else (left - edges[0]) / edges[2]
    out[count + 1] = 0.0 if math.isnan(edges[1]) else (right - edges[1]) / edges[2]
    out[count + 2] = (values[3] - usual[0]) / usual[1]
    out[count + 3] = (values[4] - usual[2]) / usual[3]


@njit(
    void(_GIVEN, _GIVEN, _SEEN, float64, _GIVEN, _GIVEN, _MAP),
    nogil=True,
    cache=True,
)
def jacobian_of(
    values: Float64,
    residuals: Float64,
    seen: Float64,
    share: float,
    usual: Float64,
    edges: Float64,
    out: Float64,
) -> None:
    """(5, B + 4) derivatives of the residuals, into `out`, by forward differences.

    Args:
        values: (5,) rectangle.
        residuals: (B + 4,) of it.
        seen: (3, B).
        share: as of `residuals_of`.
        usual: (4,).
        edges: (3,).
        out: changed.
    """
    moved = values.copy()
    for k in range(SIZE):
        moved[k] = values[k] + STEP
        residuals_of(moved, seen, share, usual, edges, out[k])
        moved[k] = values[k]
        for i in range(len(residuals)):
            out[k, i] = (out[k, i] - residuals[i]) / STEP


@njit(float64(_GIVEN), nogil=True, cache=True)
def _loss(residuals: Float64) -> float:
    """Pseudo-Huber."""
    total = 0.0
    for r in residuals:
        total += 2 * BENT * BENT * (math.sqrt(1.0 + (r / BENT) * (r / BENT)) - 1.0)
    return total


@njit(types.boolean(_MAP, _VALUES), nogil=True, cache=True)
def _solved(a: Float64, b: Float64) -> bool:
    """Solve a x = b in place by elimination with pivots; whether there is one solution."""
    for k in range(SIZE):
        pivot = k + np.argmax(np.abs(a[k:, k]))
        if a[pivot, k] == 0.0:
            return False
        for j in range(SIZE):
            a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
        b[k], b[pivot] = b[pivot], b[k]
        for i in range(k + 1, SIZE):
            factor = a[i, k] / a[k, k]
            for j in range(k, SIZE):
                a[i, j] -= factor * a[k, j]
            b[i] -= factor * b[k]
    for k in range(SIZE - 1, -1, -1):
        for j in range(k + 1, SIZE):
            b[k] -= a[k, j] * b[j]
        b[k] /= a[k, k]
    return True


@njit(
    void(_GIVEN, _MAP, float64, _MAP, _VALUES),
    nogil=True,
    cache=True,
)
def _normal_equations(
    residuals: Float64, jacobian: Float64, damping: float, hessian: Float64, slope: Float64
) -> None:
    """Damped by the diagonal, each residual weighed by its loss; into `hessian` and `slope`."""
    hessian[:], slope[:] = 0.0, 0.0
    for i in range(len(residuals)):
        weight = 1.0 / math.sqrt(1.0 + (residuals[i] / BENT) * (residuals[i] / BENT))
        for j in range(SIZE):
            weighed = weight * jacobian[j, i]
            slope[j] -= weighed * residuals[i]
            for k in range(SIZE):
                hessian[j, k] += weighed * jacobian[k, i]
    for j in range(SIZE):
        hessian[j, j] *= 1.0 + damping


@njit(
    float64(_VALUES, _SEEN, float64, _GIVEN, _GIVEN, types.int64),
    nogil=True,
    cache=True,
)
def descend(
    values: Float64,
    seen: Float64,
    share: float,
    usual: Float64,
    edges: Float64,
    rounds: int,
) -> float:
    """Move a rectangle to where it fits better, in place.

    Args:
        values: (5,) rectangle; changed.
        seen: (3, B).
        share: as of `residuals_of`.
        usual: (4,).
        edges: (3,).
        rounds: steps that are tried.

    Returns:
        What of the loss is left.
    """
    size = seen.shape[1] + 4
    residuals, new, jacobian = np.empty(size), np.empty(size), np.empty((SIZE, size))
    hessian, step, tried = np.empty((SIZE, SIZE)), np.empty(SIZE), np.empty(SIZE)
    residuals_of(values, seen, share, usual, edges, residuals)
    loss, damping, moved = _loss(residuals), DAMPING, True
    for _ in range(rounds):
        if moved:
            jacobian_of(values, residuals, seen, share, usual, edges, jacobian)
        _normal_equations(residuals, jacobian, damping, hessian, step)
        moved = False
        if _solved(hessian, step):
            for j in range(SIZE):
                tried[j] = values[j] + min(max(step[j], -LONGEST_STEP), LONGEST_STEP)
            tried[3], tried[4] = max(tried[3], SMALLEST_M), max(tried[4], SMALLEST_M)
            residuals_of(tried, seen, share, usual, edges, new)
            new_loss = _loss(new)
            moved = new_loss < loss
        if moved:
            loss = new_loss
            values[:], residuals[:] = tried, new
        damping *= EASED if moved else RAISED
    return loss


def best_rectangle(
    starts: Float64, seen: Float64, share: float, usual: Float64, edges: Float64, rounds: int
) -> Float64:
    """(5,) the rectangle with the least loss of those that (S, 5) starts lead to.

    Args:
        starts: (S, 5).
        seen: (3, B).
        share: as of `residuals_of`.
        usual: (4,).
        edges: (3,).
        rounds: steps that are tried from each.
    """
    values = np.ascontiguousarray(starts, np.float64).copy()
    left = [descend(one, seen, share, usual, edges, rounds) for one in values]
    return np.asarray(values[int(np.argmin(left))])
