"""Planes through square blocks of a disparity map."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

BLOCK_PX = 8
# Share of a block's pixels that must lie on its plane, and how near they must: pixels that are
# farther off, px, are of something else.
LEAST_SHARE, ON_PLANE_PX = 0.6, 1.0
# Columns of the result: centre u, v; disparity there; slopes along u and v; rms of residuals.
COLUMNS = 6

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def _plane(values: AnyArray, top: int, left: int, plane: AnyArray, refine: bool) -> int:
    """Least squares plane of one block; (slope u, slope v, centre, rms) into `plane`.

    Returns how many pixels it rests on, 0 for no plane.
    """
    half = (BLOCK_PX - 1) / 2.0
    n = 0
    s = sx = sy = sxx = sxy = syy = sxd = syd = sdd = 0.0
    for j in range(BLOCK_PX):
        y = j - half
        for i in range(BLOCK_PX):
            d = values[top + j, left + i]
            if not math.isfinite(d):
                continue
            x = i - half
            # About the last plane: small numbers lose no digits.
            e = d - (plane[0] * x + plane[1] * y + plane[2]) if refine else d - plane[2]
            if refine and abs(e) > ON_PLANE_PX:
                continue
            n += 1
            s += e
            sx += x
            sy += y
            sxx += x * x
            sxy += x * y
            syy += y * y
            sxd += x * e
            syd += y * e
            sdd += e * e
    if n < LEAST_SHARE * BLOCK_PX * BLOCK_PX:
        return 0
    cxx, cxy, cyy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    cxd, cyd, cdd = sxd - sx * s / n, syd - sy * s / n, sdd - s * s / n
    determinant = cxx * cyy - cxy * cxy
    if not determinant > 0.05 * cxx * cyy:
        return 0
    a = (cxd * cyy - cyd * cxy) / determinant
    b = (cyd * cxx - cxd * cxy) / determinant
    c = (s - a * sx - b * sy) / n
    left_over = max(cdd - a * cxd - b * cyd, 0.0)
    if refine:
        plane[0] += a
        plane[1] += b
    else:
        plane[0], plane[1] = a, b
    plane[2] += c
    plane[3] = math.sqrt(left_over / n)
    return n


@_kernel
def _first_value(values: AnyArray, top: int, left: int) -> float:
    """A disparity of the block, NaN where there is none."""
    for j in range(BLOCK_PX):
        for i in range(BLOCK_PX):
            if math.isfinite(values[top + j, left + i]):
                return values[top + j, left + i]
    return np.nan


@_kernel
def block_planes(values: AnyArray, out: AnyArray) -> int:
    """Planes `d = d0 + a (u - u0) + b (v - v0)` of all blocks that have one, row by row.

    Args:
        values: (H, W) float32 px, NaN where unknown.
        out: (blocks, COLUMNS) float64 out; at least one row for each whole block.

    Returns:
        How many rows were filled.
    """
    height, width = values.shape
    half = (BLOCK_PX - 1) / 2.0
    plane = np.empty(4)
    count = 0
    for row in range(height // BLOCK_PX):
        for column in range(width // BLOCK_PX):
            top, left = row * BLOCK_PX, column * BLOCK_PX
            plane[:] = 0.0
            plane[2] = _first_value(values, top, left)
            if not math.isfinite(plane[2]):
                continue
            if _plane(values, top, left, plane, False) == 0:
                continue
            if _plane(values, top, left, plane, True) == 0:
                continue
            out[count, 0], out[count, 1] = left + half, top + half
            out[count, 2], out[count, 3], out[count, 4] = plane[2], plane[0], plane[1]
            out[count, 5] = plane[3]
            count += 1
    return count
