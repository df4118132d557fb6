"""Points in the order of an octree: Morton codes, and from them the level of each point."""

from __future__ import annotations

import numpy as np
from numba import njit

from pseudolidar.geometry.octree import DEPTH
from pseudolidar.structures.arrays import AnyArray

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")

# The code of what has no place.
NOWHERE = 0xFFFF_FFFF_FFFF_FFFF


@_kernel
def _spread(value: int) -> np.uint64:
    """21 bits with two zeros between each."""
    x = np.uint64(value) & np.uint64(0x1FFFFF)
    x = (x | (x << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
    x = (x | (x << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
    x = (x | (x << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    x = (x | (x << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (x | (x << np.uint64(2))) & np.uint64(0x1249249249249249)


@_kernel
def bounds(xyz: AnyArray, least: AnyArray, most: AnyArray, low: AnyArray, high: AnyArray) -> None:
    """Corners of the box around the points that are finite and within limits.

    Args:
        xyz: (N, 3) m.
        least: (3,) float64 limits of each axis.
        most: (3,) float64, likewise.
        low: (3,) float64 out, lowered where points are lower.
        high: (3,) float64 out, likewise.
    """
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        inside = least[0] <= x <= most[0] and least[1] <= y <= most[1] and least[2] <= z <= most[2]
        if inside and np.isfinite(x) and np.isfinite(y) and np.isfinite(z):
            low[0], high[0] = min(low[0], x), max(high[0], x)
            low[1], high[1] = min(low[1], y), max(high[1], y)
            low[2], high[2] = min(low[2], z), max(high[2], z)


@_kernel
def morton_codes(xyz: AnyArray, low: AnyArray, size: float, out: AnyArray) -> None:
    """The code of each point's smallest cell; `NOWHERE` for points that are not finite.

    Of a point outside the cube that is the nearest cell.

    Args:
        xyz: (N, 3) m.
        low: (3,) float64 corner of the cube.
        size: its edge, m.
        out: (N,) uint64 out.
    """
    cells = 1 << DEPTH
    scale, last = cells / size, cells - 1.0
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)):
            out[i] = np.uint64(NOWHERE)
            continue
        # Before they are integers, which far places do not fit into.
        a = int(min(max((x - low[0]) * scale, 0.0), last))
        b = int(min(max((y - low[1]) * scale, 0.0), last))
        c = int(min(max((z - low[2]) * scale, 0.0), last))
        out[i] = (_spread(a) << np.uint64(2)) | (_spread(b) << np.uint64(1)) | _spread(c)


@_kernel
def first_depths(codes: AnyArray, out: AnyArray) -> None:
    """From which depth of cells on each point is the first one of its cell.

    Args:
        codes: (N,) uint64, sorted.
        out: (N,) uint8 out: 0 to `DEPTH`; `DEPTH + 1` where a point shares the smallest cell.
    """
    if len(codes):
        out[0] = 0
    for i in range(1, len(codes)):
        apart = codes[i] ^ codes[i - 1]
        bits = 0
        while apart:
            apart >>= np.uint64(3)
            bits += 1
        out[i] = DEPTH + 1 - bits


@_kernel
def settle_levels(codes: AnyArray, grid: int, most: int, levels: AnyArray) -> None:
    """The level that each point is drawn from: as coarse a one as its grid has room for.

    Args:
        codes: (N,) uint64, sorted.
        grid: a node has 2^grid cells along each edge, one point each.
        most: nodes with no more points left than this keep them all.
        levels: (N,) uint8: depths of `first_depths` in, levels out.
    """
    n, last = len(codes), DEPTH - grid
    for i in range(n):
        levels[i] = min(max(int(levels[i]) - grid, 0), last)
    for level in range(last):
        shift = np.uint64(3 * (DEPTH - level))
        start = 0
        while start < n:
            cell = codes[start] >> shift
            end, left = start, 0
            while end < n and codes[end] >> shift == cell:
                left += levels[end] >= level
                end += 1
            if left <= most:
                for i in range(start, end):
                    levels[i] = min(int(levels[i]), level)
            start = end


@_kernel
def in_levels(levels: AnyArray, counts: AnyArray, out: AnyArray) -> None:
    """Positions of points sorted by level, otherwise in their order.

    Args:
        levels: (N,) uint8.
        counts: (L,) int64 points of each level.
        out: (N,) int64 out.
    """
    at = np.zeros(len(counts), np.int64)
    for level in range(1, len(counts)):
        at[level] = at[level - 1] + counts[level - 1]
    for i in range(len(levels)):
        level = levels[i]
        out[at[level]] = i
        at[level] += 1


@_kernel
def node_starts(codes: AnyArray, levels: AnyArray, order: AnyArray, out: AnyArray) -> int:
    """Where nodes begin among points that are sorted by level.

    Args:
        codes: (N,) uint64, sorted.
        levels: (N,) uint8.
        order: (N,) int64 of `in_levels`.
        out: (N,) uint8 out: 1 where a node begins.

    Returns:
        How many nodes.
    """
    found = 0
    for k in range(len(order)):
        i = order[k]
        shift = np.uint64(3 * (DEPTH - int(levels[i])))
        before = order[max(k - 1, 0)]
        new = k == 0 or levels[i] != levels[before]
        new = new or codes[i] >> shift != codes[before] >> shift
        out[k] = new
        found += new
    return found
