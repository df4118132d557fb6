"""Finds the sky in a picture by flooding from its upper border; import it late: it loads numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Edge of the square cells that the picture is flooded in, px.
CELL_PX = 4
# Cells around a region of sky in which pixels as bright as it are sky, too.
RIM_CELLS = 2
# Levels (of 255): largest contrast inside a cell, step from cell to cell, and difference of a pixel
# of the rim from the sky beside it. Clouds are softer, leaves and roofs are not.
CONTRAST, STEP, LIKE = 14, 10, 14
# Sky is blue, white or grey: its blue is at most this far below its red, levels.
WARMEST = 4
UNKNOWN, REFUSED = 0, -1

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def _looked_at(grey: AnyArray, colour: AnyArray, row: int, column: int) -> tuple[int, int, bool]:
    """Mean, contrast, and whether its colour may be sky's, of a cell."""
    low, high, total, red, blue = 255, 0, 0, 0, 0
    top, left = CELL_PX * row, CELL_PX * column
    for y in range(top, top + CELL_PX):
        for x in range(left, left + CELL_PX):
            level = np.int64(grey[y, x])
            low, high, total = min(low, level), max(high, level), total + level
            if colour.shape[2] == 3:
                red, blue = red + np.int64(colour[y, x, 0]), blue + np.int64(colour[y, x, 2])
    area = CELL_PX * CELL_PX
    return total // area, high - low, red - blue <= WARMEST * area


@_kernel
def flood(grey: AnyArray, colour: AnyArray, bright: int, region: AnyArray, mean: AnyArray) -> int:
    """Number the smooth, bright regions that hang together with the upper border.

    Args:
        grey: (H, W) uint8.
        colour: (H, W, 3) uint8 RGB, or (1, 1, 1) for none.
        bright: darkest sky, levels.
        region: (rows, columns) int32 out, cells: 1, 2, ..., or not positive; zeros at first.
        mean: (rows, columns) uint8 out, level of each cell of a region.

    Returns:
        Number of regions.
    """
    rows, columns = region.shape
    stack = np.empty(rows * columns, np.int32)
    count = 0
    for start in range(columns):
        if region[0, start] != UNKNOWN:
            continue
        level, contrast, cold = _looked_at(grey, colour, 0, start)
        if contrast > CONTRAST or level < bright or not cold:
            region[0, start] = REFUSED
            continue
        count += 1
        region[0, start], mean[0, start] = count, level
        stack[0], depth = start, 1
        while depth:
            depth -= 1
            at = stack[depth]
            row, column = at // columns, at % columns
            for k in range(4):
                r = row + (1 if k == 0 else (-1 if k == 1 else 0))
                c = column + (1 if k == 2 else (-1 if k == 3 else 0))
                if not (0 <= r < rows and 0 <= c < columns) or region[r, c] != UNKNOWN:
                    continue
                level, contrast, cold = _looked_at(grey, colour, r, c)
                if contrast > CONTRAST or level < bright or not cold:
                    region[r, c] = REFUSED
                elif abs(level - np.int64(mean[row, column])) <= STEP:
                    region[r, c], mean[r, c] = count, level
                    stack[depth] = r * columns + c
                    depth += 1
    return count


@_kernel
def census_of_regions(
    values: AnyArray, region: AnyArray, near_px: float, cells: AnyArray, near: AnyArray
) -> None:
    """Cells of each region, and how many of them hold something nearer than `near_px`.

    Args:
        values: (H, W) px, NaN = none.
        region: as `flood` has filled it.
        near_px: disparity of what cannot be sky.
        cells: (regions + 1,) int64 out, zeros at first.
        near: (regions + 1,) int64 out, zeros at first.
    """
    rows, columns = region.shape
    half = CELL_PX // 2
    for r in range(rows):
        for c in range(columns):
            k = region[r, c]
            if k > 0:
                cells[k] += 1
                near[k] += values[CELL_PX * r + half, CELL_PX * c + half] > near_px


@_kernel
def mark_sky(
    values: AnyArray,
    grey: AnyArray,
    region: AnyArray,
    mean: AnyArray,
    is_sky: AnyArray,
    rim: AnyArray,
    why: int,
    reason: AnyArray,
) -> None:
    """Mark disparities in regions of sky, and like pixels of the rim around them.

    Args:
        values: (H, W) px, NaN = none.
        grey: (H, W) uint8.
        region: as `flood` has filled it.
        mean: as `flood` has filled it.
        is_sky: (regions + 1,) bool.
        rim: (rows, columns) bool, cells of sky and those around it.
        why: what to mark them by.
        reason: (H, W) uint8 out.
    """
    rows, columns = region.shape
    height, width = values.shape
    for row in range(min(rows + 1, -(-height // CELL_PX))):
        for column in range(-(-width // CELL_PX)):
            r, c = min(row, rows - 1), min(column, columns - 1)
            if not rim[r, c]:
                continue
            inside = row < rows and column < columns
            if inside and region[r, c] > 0 and is_sky[region[r, c]]:
                low, high = 0, 255
            else:
                low, high = 255, 0
                for v in range(max(r - RIM_CELLS, 0), min(r + RIM_CELLS + 1, rows)):
                    for u in range(max(c - RIM_CELLS, 0), min(c + RIM_CELLS + 1, columns)):
                        if region[v, u] > 0 and is_sky[region[v, u]]:
                            level = np.int64(mean[v, u])
                            low, high = min(low, level - LIKE), max(high, level + LIKE)
                if low > high:
                    continue
            for y in range(CELL_PX * row, min(CELL_PX * (row + 1), height)):
                for x in range(CELL_PX * column, min(CELL_PX * (column + 1), width)):
                    known = values[y, x] == values[y, x] and reason[y, x] == 0
                    if known and low <= np.int64(grey[y, x]) <= high:
                        reason[y, x] = why
