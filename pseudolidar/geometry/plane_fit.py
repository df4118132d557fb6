"""The plane that most of some points lie on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import AnyArray, Bool, Float64

# Planes through three points that are tried on so many points; with half of these on the plane
# 3 in 10^8 searches never take three of them.
TRIALS, TRIED_ON, SEED = 130, 2000, 7
# A point belongs to the plane within so many standard deviations of those that do.
MOST_SIGMAS = 3.0
MOST_ROUNDS = 20
# Points that are this thin across, as a share of how far they reach, are on a line.
THINNEST = 1e-5
# What rounding makes of exact planes, as a share of how far points reach: that of float32.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class FittedPlane:
    """A plane, and what of the points lies on it.

    Args:
        normal: (3,) of length 1, to either side.
        middle: (3,) mean of the points on it.
        distances: (N,) signed, of all points.
        on: (N,) which points belong to it.
    """

    normal: Float64
    middle: Float64
    distances: Float64
    on: Bool


def fit_plane(xyz: AnyArray) -> FittedPlane | None:
    """The plane that at least half of the points lie on, least squares of those that do.

    Args:
        xyz: (N, 3), finite.

    Returns:
        None where no plane is told: of fewer than three points, or of points on a line.

    Source: Rousseeuw & Leroy, Robust Regression and Outlier Detection, 1987, chapter 5: least
    median of squares, then reweighted least squares.
    """
    if len(xyz) < 3:
        return None
    points = xyz.astype(np.float64)
    points -= (origin := points.mean(axis=0))
    reach = float(np.abs(points).max())
    normal, middle = _least_median(points)
    for _ in range(MOST_ROUNDS):
        distances = (points - middle) @ normal
        on = _near(distances, reach)
        _, axes, lengths = principal(points[on])
        middle = points[on].mean(axis=0)
        if lengths[1] <= THINNEST * lengths[0] or lengths[0] <= 0:
            return None
        normal = axes[:, 2]
        distances = (points - middle) @ normal
        if np.array_equal(on, _near(distances, reach)):
            break
    return FittedPlane(normal, origin + middle, distances, on)


def principal(xyz: Float64) -> tuple[Float64, Float64, Float64]:
    """Middle (3,), axes (3, 3) as columns and standard deviations (3,) of points, largest first."""
    middle = xyz.mean(axis=0)
    away = xyz - middle
    values, axes = np.linalg.eigh(away.T @ away / len(xyz))
    return middle, axes[:, ::-1], np.sqrt(np.maximum(values[::-1], 0))


def _near(distances: Float64, reach: float) -> Bool:
    within = max(MOST_SIGMAS * robust_sigma(distances), ROUNDING * reach)
    return np.asarray(np.abs(distances) <= within)


def _least_median(points: Float64) -> tuple[Float64, Float64]:
    """Normal (3,) and a place (3,) of the best plane through three of the points."""
    rng = np.random.default_rng(SEED)
    few = points[rng.permutation(len(points))[:TRIED_ON]]
    a, b, c = few[rng.integers(0, len(few), (TRIALS, 3))].transpose(1, 0, 2)
    _, axes, _ = principal(few)
    normals = np.concatenate([np.cross(b - a, c - a), axes[:, 2][None]])
    middles = np.concatenate([a, few.mean(axis=0)[None]])  # with all points: few may have no three
    lengths = np.linalg.norm(normals, axis=1)
    told = lengths > 0
    normals, middles = normals[told] / lengths[told, None], middles[told]
    away = np.abs(few @ normals.T - np.einsum("ni,ni->n", middles, normals))
    best = int(np.argmin(np.median(away, axis=0)))
    return normals[best], middles[best]
