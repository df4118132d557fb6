"""One point per cube of space; a numba kernel, import it late."""

from __future__ import annotations

import math

import numpy as np
from numba import float32, float64, int64, njit, types

from pseudolidar.structures.arrays import AnyArray, Float32, Int64

# Multipliers of the spatial hash. Source: Teschner et al., Optimized Spatial Hashing for Collision
# Detection of Deformable Objects, VMV 2003, section 4.1.
_PRIMES = (73856093, 19349663, 83492791)
# Slots per point: an open-addressing table stays fast below this load.
_SLOTS_PER_POINT = 2


def best_of_voxel(xyz: AnyArray, sigma_m: Float32 | None, *, voxel_m: float) -> Int64:
    """Indices, ascending, of one point of each occupied cube: the one with the smallest sigma.

    Real points are kept, not averages, so that every column stays true. Ties and clouds without
    sigma keep the first; a point of unknown sigma (NaN) gives way to any other. Points that are not
    finite are dropped.

    Args:
        xyz: (N, 3) m.
        sigma_m: (N,) m, or None.
        voxel_m: edge of a cube; cubes are aligned to the origin of the frame.

    Returns:
        (M,) int64.
    """
    points = np.ascontiguousarray(xyz, np.float64)
    sigma = np.zeros(len(points), np.float32) if sigma_m is None else sigma_m
    bits = max(4, int(_SLOTS_PER_POINT * len(points)).bit_length())
    kept = _best(points, np.ascontiguousarray(sigma), voxel_m, np.full(1 << bits, -1))
    return np.flatnonzero(kept)


@njit(
    types.Array(types.boolean, 1, "C")(
        types.Array(float64, 2, "C", readonly=True),
        types.Array(float32, 1, "C", readonly=True),
        float64,
        int64[::1],
    ),
    nogil=True,
    cache=True,
)
def _best(xyz, sigma, voxel_m, slots):  # type: ignore[no-untyped-def]
    n, last = len(xyz), len(slots) - 1
    cells = np.empty((n, 3), np.int64)
    kept = np.zeros(n, np.bool_)
    for i in range(n):
        if not math.isfinite(xyz[i, 0] + xyz[i, 1] + xyz[i, 2]):
            continue
        x, y, z = (
            int64(math.floor(xyz[i, 0] / voxel_m)),
            int64(math.floor(xyz[i, 1] / voxel_m)),
            int64(math.floor(xyz[i, 2] / voxel_m)),
        )
        cells[i, 0], cells[i, 1], cells[i, 2] = x, y, z
        slot = (x * _PRIMES[0] ^ y * _PRIMES[1] ^ z * _PRIMES[2]) & last
        while True:
            j = slots[slot]
            if j < 0:
                slots[slot], kept[i] = i, True
                break
            if cells[j, 0] == x and cells[j, 1] == y and cells[j, 2] == z:
                if sigma[i] < sigma[j] or (math.isnan(sigma[j]) and not math.isnan(sigma[i])):
                    slots[slot], kept[i], kept[j] = i, True, False
                break
            slot = (slot + 1) & last
    return kept
