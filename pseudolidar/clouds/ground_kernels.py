"""Which points lie low, how well planes fit them, which lie on one; numba kernels, import late.

Points are turned one by one, in their own precision and in the order of `Pose.apply`: a whole cloud
in other axes is never made.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import float32, float64, int64, njit, types

from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64, Int64

_EITHER = (float32, float64)


def _given(kind: Any, dimensions: int) -> Any:
    """An array that is read."""
    return types.Array(kind, dimensions, "C", readonly=True)


@njit(
    [
        types.Tuple((int64[::1], types.Array(kind, 2, "C")))(
            *(_given(kind, 2), _given(kind, 2), _given(float64, 1)),
            *(float64, float64, float64, int64),
        )
        for kind in _EITHER
    ],
    nogil=True,
    cache=True,
)
def low_points(
    xyz: AnyArray,
    pose: AnyArray,
    origin_m: Float64,
    below_m: float,
    nearest_m: float,
    farthest_m: float,
    most: int,
) -> tuple[Int64, AnyArray]:
    """Points below a sensor, at some distance from it as seen from above.

    Args:
        xyz: (N, 3) m; NaN where there is none.
        pose: (3, 4) to a frame with z up.
        origin_m: (3,) the sensor in that frame.
        below_m: they are lower than it by more than this.
        nearest_m: they are farther than this.
        farthest_m: and nearer than this.
        most: where twice as many are so low, only every so manyth of them is looked at.

    Returns:
        (M,) indices, ascending, and (M, 3) the points in the frame with z up.
    """
    low, count = np.empty(len(xyz), np.int64), 0
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        height = x * pose[2, 0] + y * pose[2, 1] + z * pose[2, 2] + pose[2, 3]
        if float64(height) < origin_m[2] - below_m:  # False for NaN
            low[count] = i
            count += 1
    step, kept = max(1, count // most), 0
    points = np.empty((-(-count // step), 3), xyz.dtype)
    for j in range(0, count, step):
        x, y, z = xyz[low[j], 0], xyz[low[j], 1], xyz[low[j], 2]
        a = x * pose[0, 0] + y * pose[0, 1] + z * pose[0, 2] + pose[0, 3]
        b = x * pose[1, 0] + y * pose[1, 1] + z * pose[1, 2] + pose[1, 3]
        ahead_m, aside_m = float64(a) - origin_m[0], float64(b) - origin_m[1]
        away = ahead_m * ahead_m + aside_m * aside_m
        if nearest_m * nearest_m < away < farthest_m * farthest_m:
            points[kept, 0], points[kept, 1] = a, b
            points[kept, 2] = x * pose[2, 0] + y * pose[2, 1] + z * pose[2, 2] + pose[2, 3]
            low[kept] = low[j]
            kept += 1
    return low[:kept].copy(), points[:kept].copy()


@njit(
    [
        types.Array(types.boolean, 1, "C")(
            *(_given(kind, 2), _given(float32, 1), _given(kind, 2), _given(kind, 1)),
            *(_given(kind, 1), float64, float64),
        )
        for kind in _EITHER
    ],
    nogil=True,
    cache=True,
)
def points_on_plane(
    xyz: AnyArray,
    sigma_m: Float32,
    pose: AnyArray,
    plane: AnyArray,
    origin_m: AnyArray,
    above_m: float,
    thickness_m: float,
) -> Bool:
    """Points that lie on a plane: within its thickness, or twice their error across it.

    That error counts up to the thickness: never is much more than the height of a kerb ground.

    Args:
        xyz: (N, 3) m.
        sigma_m: (N,) m along the ray; (0,) where there is none.
        pose: (3, 4) to the frame of the plane.
        plane: (4,) normal and offset.
        origin_m: (3,) where the points were seen from, in that frame.
        above_m: height of that above the plane.
        thickness_m: half of the layer that counts as the plane.

    Returns:
        (N,) bool.
    """
    exact = len(sigma_m) == 0
    found = np.zeros(len(xyz), np.bool_)
    reach_m = xyz.dtype.type(thickness_m if exact else 2 * thickness_m)
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        a = x * pose[0, 0] + y * pose[0, 1] + z * pose[0, 2] + pose[0, 3]
        b = x * pose[1, 0] + y * pose[1, 1] + z * pose[1, 2] + pose[1, 3]
        c = x * pose[2, 0] + y * pose[2, 1] + z * pose[2, 2] + pose[2, 3]
        height = abs(plane[0] * a + plane[1] * b + plane[2] * c + plane[3])
        if not height <= reach_m:  # False for NaN
            continue
        if exact:
            found[i] = True
            continue
        a, b, c = a - origin_m[0], b - origin_m[1], c - origin_m[2]
        across_m = 2 * (float64(sigma_m[i]) * above_m / math.sqrt(a * a + b * b + c * c))
        if not math.isnan(across_m):
            found[i] = height <= max(thickness_m, across_m)
    return found


@njit(
    float64[::1](_given(float64, 2), _given(float64, 2), _given(float64, 1), float64, float64),
    nogil=True,
    cache=True,
)
def misfits(
    planes: Float64, points: Float64, sigma_m: Float64, cut_sigmas: float, below_factor: float
) -> Float64:
    """Truncated squared deviations of points from planes, summed.

    Args:
        planes: (K, 3) a, b, c of z = a x + b y + c.
        points: (M, 3) m.
        sigma_m: (M,) m.
        cut_sigmas: larger deviations count as this.
        below_factor: so many times does a point count that lies farther below than that.

    Returns:
        (K,).
    """
    found, most = np.zeros(len(planes)), cut_sigmas * cut_sigmas
    for k in range(len(planes)):
        a, b, c = planes[k, 0], planes[k, 1], planes[k, 2]
        total = 0.0
        for i in range(len(points)):
            off = points[i, 2] - a * points[i, 0] - b * points[i, 1] - c
            ratio = off / sigma_m[i]
            loss = min(ratio * ratio, most)
            total += loss * below_factor if ratio < -cut_sigmas else loss
        found[k] = total
    return found
