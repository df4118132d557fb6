"""Which points the beams of a spinning LiDAR meet."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Half the vertical width in which a point counts as met by a beam, degrees: beams of the upper
# block are 0.33 apart, and stereo pixels 0.08 (KITTI).
HALF_FOOTPRINT_DEG = 0.125
# Points farther than the first by more than this share belong to what lies behind it.
SAME_SURFACE_SHARE = 0.008

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def _nearest_beam(elevations: AnyArray, elevation: float) -> int:
    low, high = 0, len(elevations) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if elevations[middle] <= elevation:
            low = middle
        else:
            high = middle
    return low if elevation - elevations[low] <= elevations[high] - elevation else high


@_kernel
def nearest_returns(
    xyz: AnyArray, elevations: AnyArray, steps: int, limits: AnyArray, keep: AnyArray
) -> None:
    """Mark one point for each firing whose footprint holds any.

    Args:
        xyz: (N, 3) float64 m from the LiDAR, x forward, y left, z up.
        elevations: (L,) of the beams, rad, ascending.
        steps: firings of a turn.
        limits: (2,) nearest and farthest range, m.
        keep: (N,) bool out, all False before.
    """
    count = len(xyz)
    cell = np.full(count, -1, np.int64)
    off, away = np.empty(count), np.empty(count)
    nearest = np.full(len(elevations) * steps, np.inf)
    half = math.radians(HALF_FOOTPRINT_DEG)
    step_rad = 2 * math.pi / steps
    for i in range(count):
        x, y, z = xyz[i]
        flat = math.hypot(x, y)
        r = math.hypot(flat, z)
        if not (limits[0] <= r <= limits[1]):
            continue
        elevation, azimuth = math.atan2(z, flat), math.atan2(y, x)
        beam = _nearest_beam(elevations, elevation)
        aside = elevation - elevations[beam]
        if abs(aside) > half:
            continue
        firing = math.floor(azimuth / step_rad + 0.5)
        turned = (azimuth - firing * step_rad) * math.cos(elevation)
        k = beam * steps + firing % steps
        cell[i], off[i], away[i] = k, aside * aside + turned * turned, r
        nearest[k] = min(nearest[k], r)
    best = np.full(len(nearest), -1, np.int64)
    for i in range(count):
        k = cell[i]
        if k < 0 or away[i] > nearest[k] * (1 + SAME_SURFACE_SHARE):
            continue
        if best[k] < 0 or off[i] < off[best[k]]:
            best[k] = i
    for k in range(len(best)):
        if best[k] >= 0:
            keep[best[k]] = True
