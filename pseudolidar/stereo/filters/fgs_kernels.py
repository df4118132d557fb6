"""Links between neighbouring pixels and tridiagonal solves of the fast global smoother."""

from __future__ import annotations

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def edge_weights(guide: AnyArray, table: AnyArray, down: AnyArray, right: AnyArray) -> None:
    """How strongly each pixel is tied to the one below and to the one on its right.

    Args:
        guide: (H, W, C) uint8.
        table: weight by the squared distance of two colours, (C * 255^2 + 1,) float32.
        down: (H, W) float32 out, last row 0.
        right: (W, H) float32 out, transposed, last row 0.
    """
    height, width, channels = guide.shape
    for y in range(height):
        for x in range(width):
            below = beside = np.int32(0)
            for c in range(channels):
                value = np.int32(guide[y, x, c])
                if y + 1 < height:
                    step = value - np.int32(guide[y + 1, x, c])
                    below += step * step
                if x + 1 < width:
                    step = value - np.int32(guide[y, x + 1, c])
                    beside += step * step
            down[y, x] = table[below] if y + 1 < height else np.float32(0)
            right[x, y] = table[beside] if x + 1 < width else np.float32(0)


@_kernel
def solve_columns(weights: AnyArray, strength: float, maps: AnyArray, ratios: AnyArray) -> None:
    """Smooth every column of each map in place: (I + strength L) u = f, by Thomas' algorithm.

    L is the Laplacian of a chain whose links have `weights`. Columns are independent, so the inner
    loops run along the rows and vectorise.

    Args:
        weights: (H, W) float32 of the link from row y to y + 1; last row 0.
        strength: lambda of this pass.
        maps: (K, H, W) float32.
        ratios: (H, W) float32 working memory.
    """
    count, height, width = maps.shape
    lam, one = np.float32(strength), np.float32(1)
    above, pivot = np.empty(width, np.float32), np.empty(width, np.float32)
    for x in range(width):
        below = lam * weights[0, x]
        pivot[x] = one / (one + below)
        ratios[0, x] = below * pivot[x]
    for k in range(count):
        row = maps[k, 0]
        for x in range(width):
            row[x] *= pivot[x]
    for y in range(1, height):
        links, links_above = weights[y], weights[y - 1]
        ratio, ratio_above = ratios[y], ratios[y - 1]
        for x in range(width):
            above[x] = lam * links_above[x]
            below = lam * links[x]
            pivot[x] = one / (one + below + above[x] * (one - ratio_above[x]))
            ratio[x] = below * pivot[x]
        for k in range(count):
            row, row_above = maps[k, y], maps[k, y - 1]
            for x in range(width):
                row[x] = (row[x] + above[x] * row_above[x]) * pivot[x]
    for y in range(height - 2, -1, -1):
        ratio = ratios[y]
        for k in range(count):
            row, row_below = maps[k, y], maps[k, y + 1]
            for x in range(width):
                row[x] += ratio[x] * row_below[x]


@_kernel
def weighed_slopes(values: AnyArray, confidence: AnyArray, largest: float, out: AnyArray) -> None:
    """Slopes along x and y by central differences, times confidence, and that confidence.

    Only where both neighbours of both directions are known and the surface is continuous.

    Args:
        values: (H, W) float32.
        confidence: (H, W) float32, 0 where unknown.
        largest: a steeper slope is a step between surfaces.
        out: (3, H, W) float32 out: slope along x, along y, confidence; 0 where unknown.
    """
    height, width = values.shape
    half, limit, zero = np.float32(0.5), np.float32(largest), np.float32(0)
    out[:, 0], out[:, height - 1] = zero, zero
    for y in range(1, height - 1):
        row, above, below = values[y], values[y - 1], values[y + 1]
        c, c_above, c_below = confidence[y], confidence[y - 1], confidence[y + 1]
        out[:, y, 0], out[:, y, width - 1] = zero, zero
        for x in range(1, width - 1):
            along_x, along_y = half * (row[x + 1] - row[x - 1]), half * (below[x] - above[x])
            weight = min(min(c[x - 1], c[x + 1]), min(min(c_above[x], c_below[x]), c[x]))
            if abs(along_x) > limit or abs(along_y) > limit:
                weight = zero
            out[0, y, x], out[1, y, x], out[2, y, x] = weight * along_x, weight * along_y, weight
