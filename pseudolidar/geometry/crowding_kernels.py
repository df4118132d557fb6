"""Counts points around points, each within a radius of its own; import it late: it loads numba."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, njit, types

from pseudolidar.structures.arrays import AnyArray, Bool, Float64

# Multipliers of the spatial hash. Source: Teschner et al., Optimized Spatial Hashing for Collision
# Detection of Deformable Objects, VMV 2003, section 4.1.
_PRIMES = (73856093, 19349663, 83492791)
# Slots per point: lists behind a slot stay short.
_SLOTS_PER_POINT = 2


def crowded(xyz: AnyArray, radius_m: Float64, *, neighbours: int) -> Bool:
    """Whether each point has so many others around it.

    Points are sorted into cubes, anew for every power of two of the radius: cubes about as large as
    the radius hold few points that are not looked for. Counting ends with the last one needed.

    Args:
        xyz: (N, 3) m; points that are not finite are nobody's neighbours.
        radius_m: (N,) m of the ball around each point, border included.
        neighbours: points that must be in it besides the point itself.

    Returns:
        (N,) False for points that are not finite, too.
    """
    points = np.ascontiguousarray(xyz, np.float64)
    finite = np.isfinite(points).all(axis=1)
    found = np.zeros(len(points), np.bool_)
    if not finite.any():
        return found
    rows = np.flatnonzero(finite)
    level = np.ceil(np.log2(np.maximum(radius_m[rows], np.finfo(np.float64).tiny)))
    bits = max(4, int(_SLOTS_PER_POINT * len(rows)).bit_length())
    for power in np.unique(level):
        asked = rows[level == power]
        slots = np.full(1 << bits, -1)
        _count(points, rows, asked, radius_m, float(2.0**power), neighbours, slots, found)
    return found


@njit(
    types.void(
        types.Array(float64, 2, "C", readonly=True),
        int64[::1],
        int64[::1],
        types.Array(float64, 1, "C", readonly=True),
        float64,
        int64,
        int64[::1],
        types.Array(types.boolean, 1, "C"),
    ),
    nogil=True,
    cache=True,
)
def _count(xyz, rows, asked, radius_m, edge_m, neighbours, slots, found):  # type: ignore[no-untyped-def]
    n, last = len(rows), len(slots) - 1
    cells = np.empty((n, 3), np.int64)
    following = np.empty(n, np.int64)
    for k in range(n):
        for axis in range(3):
            cells[k, axis] = int64(math.floor(xyz[rows[k], axis] / edge_m))
        slot = (
            cells[k, 0] * _PRIMES[0] ^ cells[k, 1] * _PRIMES[1] ^ cells[k, 2] * _PRIMES[2]
        ) & last
        following[k], slots[slot] = slots[slot], k
    for i in asked:
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        cx, cy, cz = (
            int64(math.floor(x / edge_m)),
            int64(math.floor(y / edge_m)),
            int64(math.floor(z / edge_m)),
        )
        limit = radius_m[i] * radius_m[i]
        count = -1  # the point itself
        for dx in (0, -1, 1):
            for dy in (0, -1, 1):
                for dz in (0, -1, 1):
                    if count >= neighbours:
                        break
                    a, b, c = cx + dx, cy + dy, cz + dz
                    k = slots[(a * _PRIMES[0] ^ b * _PRIMES[1] ^ c * _PRIMES[2]) & last]
                    while k >= 0 and count < neighbours:
                        if cells[k, 0] == a and cells[k, 1] == b and cells[k, 2] == c:
                            j = rows[k]
                            ex, ey, ez = xyz[j, 0] - x, xyz[j, 1] - y, xyz[j, 2] - z
                            count += ex * ex + ey * ey + ez * ez <= limit
                        k = following[k]
        found[i] = count >= neighbours
