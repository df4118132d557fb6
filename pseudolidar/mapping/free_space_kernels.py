"""How often frames see a place, and how often they see through it."""

from __future__ import annotations

import math

from numba import njit

from pseudolidar.structures.arrays import AnyArray

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def look(
    places: AnyArray,
    depth: AnyArray,
    T: AnyArray,
    camera: AnyArray,
    limits: AnyArray,
    seen: AnyArray,
    through: AnyArray,
) -> None:
    """Count what one frame says of places.

    Args:
        places: (N, 3) float32 m, relative to the same origin as `T`.
        depth: (H, W) float32 m, the nearest in each block of pixels; 0 where too little is known.
        T: (3, 4) float32 maps places into the camera.
        camera: (5,) float32: fx, fy, cx, cy of the blocks, nearest depth m.
        limits: (2,) float32: a place is at a surface within this, m, and this times its depth
            squared, 1/m.
        seen: (N,) uint16 counted up where the frame sees a surface there.
        through: (N,) uint16 counted up where it sees one behind it.
    """
    fx, fy, cx, cy, nearest = camera
    height, width = depth.shape
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        there = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if there < nearest:
            continue
        u = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / there + cx
        v = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / there + cy
        column, row = math.floor(u + 0.5), math.floor(v + 0.5)
        if not (0 <= column < width and 0 <= row < height):
            continue
        surface = depth[row, column]
        if not surface > 0:
            continue
        margin = limits[0] + limits[1] * there * there
        if surface - there > margin:
            through[i] += 1
        elif there - surface <= margin:
            seen[i] += 1


@_kernel
def nearest_of_blocks(depth: AnyArray, side: int, least: int, blocks: AnyArray) -> None:
    """The nearest depth of each block of pixels; 0 where fewer than `least` are known.

    Args:
        depth: (H, W) float32 m, NaN where unknown.
        side: of a block, px.
        least: pixels of a block that must be known.
        blocks: (H // side, W // side) float32 out.
    """
    rows, columns = blocks.shape
    for row in range(rows):
        for column in range(columns):
            known, lowest = 0, math.inf
            for v in range(row * side, (row + 1) * side):
                for u in range(column * side, (column + 1) * side):
                    z = depth[v, u]
                    if z > 0:
                        known += 1
                        lowest = min(lowest, z)
            blocks[row, column] = lowest if known >= least else 0.0
