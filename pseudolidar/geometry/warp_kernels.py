"""Where one stereo pair sees what the pixels of another one show."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def warp_maps(
    disparity: AnyArray, camera: AnyArray, offset: AnyArray, T: AnyArray, maps: AnyArray
) -> None:
    """Columns and rows in the second pair of what each pixel of the first left image shows.

    Gaps are filled by the rule of `gaps.filled`. What would lie nearer than `nearest` is moved
    there.

    Args:
        disparity: (H, W) float32 px, as measured; NaN where unknown.
        camera: (8,) float32: fx, fy, cx, cy px, f B px m, doffs px, least px that a disparity
            (plus doffs) may have, nearest depth m.
        offset: (10,) float32 coefficients of `DisparityCorrection`, taken off what was measured
            and put on what the second pair will measure.
        T: (3, 4) float32 maps points of the first left camera to the second one.
        maps: (3, H, W) float32 out: u and v in the second left image, u in the second right one.
    """
    height, width = disparity.shape
    row = np.empty(width, np.float32)
    filled = _next_row_with_values(disparity, 0)
    for v in range(height):
        if _has_value(disparity[v]):
            filled = v
        if filled < height:
            _fill(disparity[filled], row)
        else:
            row[:] = np.nan
        _map_row(row, v, height, camera, offset, T, maps)


@_kernel
def _has_value(row: AnyArray) -> bool:
    return _first_value(row, 0) < len(row)


@_kernel
def _first_value(row: AnyArray, u: int) -> int:
    while u < len(row) and not math.isfinite(row[u]):
        u += 1
    return u


@_kernel
def _next_row_with_values(disparity: AnyArray, v: int) -> int:
    while v < len(disparity) and not _has_value(disparity[v]):
        v += 1
    return v


@_kernel
def _fill(values: AnyArray, row: AnyArray) -> None:
    """Each gap takes the smaller of its two neighbours, at the border the only one."""
    width = len(row)
    before = np.float32(np.inf)
    u = 0
    while u < width:
        if math.isfinite(values[u]):
            before = values[u]
            row[u] = before
            u += 1
            continue
        end = _first_value(values, u)
        after = values[end] if end < width else np.float32(np.inf)
        row[u:end] = min(before, after)
        u = end


@_kernel
def _offset(coefficients: AnyArray, d: float, x: float, y: float) -> float:
    """As `DisparityCorrection.offset_px`, of x and y scaled to [-1, 1]."""
    c = coefficients
    flat = c[0] + c[1] * d * np.float32(0.02) + x * (c[2] + x * (c[4] + x * (c[7] + x * c[9])))
    return np.float32(flat + y * (c[3] + x * (c[5] + x * c[8]) + y * c[6]))


@_kernel
def _map_row(
    row: AnyArray,
    v: int,
    height: int,
    camera: AnyArray,
    offset: AnyArray,
    T: AnyArray,
    maps: AnyArray,
) -> None:
    fx, fy, cx, cy, fB, doffs, least, nearest = camera
    width = len(row)
    one = np.float32(1)
    x_scale, y_scale = np.float32(2) / (width - one), np.float32(2) / (height - one)
    y = (np.float32(v) - cy) / fy
    for u in range(width):
        measured = row[u]
        scaled = np.float32(u) * x_scale - one
        true = measured - _offset(offset, measured, scaled, np.float32(v) * y_scale - one)
        # Divided by the depth, so that what is at infinity stays finite.
        inverse = max(true + doffs, least) / fB
        if not math.isfinite(inverse):
            inverse = np.float32(0)
        x = (np.float32(u) - cx) / fx
        Z = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * inverse
        Z = max(Z, nearest * inverse, np.float32(1e-7))
        there = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * inverse) / Z + cx
        down = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * inverse) / Z + cy
        d = fB * inverse / Z - doffs
        d += _offset(offset, d, there * x_scale - one, down * y_scale - one)
        maps[0, v, u], maps[1, v, u], maps[2, v, u] = there, down, there - d
