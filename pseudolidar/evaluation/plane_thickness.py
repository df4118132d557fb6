"""How thick the surfaces of a map are that are plane in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Bool, Float64, Int64

# Cubes that planes are looked for in, m; so many points of so many frames must be in one.
CUBE_M, LEAST_POINTS, LEAST_FRAMES = 0.4, 40, 4
# The points of a plane spread at least so far along it, one standard deviation, m.
SPREAD_M = 0.07
# Planes are ground where the cosine of their normal to the vertical is larger.
GROUND_COSINE = 0.8


@dataclass(frozen=True, eq=False)
class PlaneThickness:
    """Cubes of space whose points lie on a plane.

    Args:
        thickness_m: (N,) one standard deviation of the points across the plane.
        ground: (N,) whether the plane is level.
    """

    thickness_m: Float64
    ground: Bool

    def median_m(self, *, ground: bool) -> float:
        """Of all that is level, or of all that is upright; NaN where there is none."""
        chosen = self.thickness_m[self.ground == ground]
        return float(np.median(chosen)) if len(chosen) else float("nan")

    def count(self, *, ground: bool) -> int:
        """Cubes that are level, or upright."""
        return int((self.ground == ground).sum())


def plane_thickness(xyz: Float64, frames: Int64) -> PlaneThickness:
    """Thickness of planes, from points of several frames.

    The root of the smallest eigenvalue of the covariance of the points in a cube: what poses and
    depths leave of a plane.

    Args:
        xyz: (N, 3) points, z up, m.
        frames: (N,) the frame that each is of.

    Source: `sqrt(lambda_min)` as in mean map entropy, Droeschel & Behnke, ICRA 2018.
    """
    cells = np.floor(xyz / CUBE_M).astype(np.int64)
    _, cube, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    cube = cube.reshape(-1)
    n = len(counts)
    pairs = np.unique(np.stack([cube, frames], axis=1), axis=0)
    enough = (counts >= LEAST_POINTS) & (np.bincount(pairs[:, 0], minlength=n) >= LEAST_FRAMES)
    values, vectors = np.linalg.eigh(_covariances(xyz, cube, counts)[enough])
    plane = values[:, 1] > SPREAD_M**2
    thickness = np.sqrt(np.maximum(values[plane, 0], 0))
    return PlaneThickness(thickness, np.abs(vectors[plane, 2, 0]) > GROUND_COSINE)


def _covariances(xyz: Float64, cube: Int64, counts: Int64) -> Float64:
    n = len(counts)
    sums = [np.bincount(cube, xyz[:, axis], n) for axis in range(3)]
    off = xyz - (np.stack(sums, axis=1) / counts[:, None])[cube]
    covariances = np.empty((n, 3, 3))
    for i in range(3):
        for j in range(3):
            covariances[:, i, j] = np.bincount(cube, off[:, i] * off[:, j], n) / counts
    return covariances
