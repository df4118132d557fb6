"""Sums over the points of cubes of space: what averages are made of, and merged by adding."""

from __future__ import annotations

import numpy as np

from pseudolidar.mapping.map_points import FramePoints
from pseudolidar.structures.arrays import AnyArray, Float64, Int64

# A cube's sums. Places are relative to its corner, in cubes; all weighed by one over variance.
SUMS = np.dtype(
    [
        ("cell", "<i4", 3),
        ("weight", "<f4"),
        ("place", "<f4", 3),
        ("rgb", "<f4", 3),
        ("normal", "<f4", 3),
        ("views", "<u2"),
    ]
)
# Sigmas below this are not believed, m: one pixel would outweigh all others.
LEAST_SIGMA_M = 0.003
# Bits of a cell's coordinate in its key.
KEY_BITS = 21
MOST_VIEWS = 65_535


def voxels_of(points: FramePoints, T_map_camera: Float64, voxel_m: float) -> AnyArray:
    """(M,) `SUMS` of the cubes that a frame's points lie in, each seen once."""
    places, normals = points.in_map(T_map_camera)
    scaled = places / voxel_m
    cells = np.floor(scaled)
    weight = 1 / np.maximum(points.sigma_m, LEAST_SIGMA_M) ** 2
    rows = np.zeros(len(points), SUMS)
    rows["cell"], rows["weight"] = cells, weight
    rows["place"] = weight[:, None] * (scaled - cells)
    rows["rgb"] = weight[:, None] * points.rgb
    rows["normal"] = weight[:, None] * normals
    summed = merged(rows)
    summed["views"] = 1
    return summed


def merged(rows: AnyArray) -> AnyArray:
    """Sums of the same cube added; in the order of their keys."""
    if not len(rows):
        return rows
    keys = keys_of(rows["cell"])
    order = np.argsort(keys, kind="stable")
    ordered = rows[order]
    begins = np.flatnonzero(np.diff(keys[order], prepend=keys[order[0]] - 1))
    added = np.empty(len(begins), SUMS)
    added["cell"] = ordered["cell"][begins]
    for name in ("weight", "place", "rgb", "normal"):
        added[name] = np.add.reduceat(ordered[name], begins, axis=0)
    views = np.add.reduceat(ordered["views"].astype(np.int64), begins)
    added["views"] = np.minimum(views, MOST_VIEWS)
    return added


def keys_of(cells: AnyArray) -> Int64:
    """(N,) one number for each cell (N, 3)."""
    shifted = cells.astype(np.int64) + (1 << (KEY_BITS - 1))
    return np.asarray((shifted[:, 0] << 2 * KEY_BITS) | (shifted[:, 1] << KEY_BITS) | shifted[:, 2])


def places_of(rows: AnyArray, voxel_m: float) -> Float64:
    """(N, 3) where the points of each cube are on average, m."""
    within = rows["place"] / rows["weight"][:, None]
    return np.asarray((rows["cell"] + within.astype(np.float64)) * voxel_m)
