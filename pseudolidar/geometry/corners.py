"""Corners to follow through pictures, spread over all of the image."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float32, UInt8

# The image is divided into so many square cells, each with its own best corners: 54 px on KITTI.
CELLS = 160
# Window whose smallest eigenvalue makes a corner, and how far apart corners are, px.
BLOCK_PX, APART_PX = 5, 6
# Nearer to the border no window of a tracker fits, px.
BORDER_PX = 12
# Weaker than this share of the image's strongest (its 99.9 % quantile) is noise.
WEAKEST, STRONGEST_QUANTILE = 0.0005, 0.999


def spread_corners(grey: UInt8, *, per_cell: int) -> Float32:
    """The strongest corners of each cell of the image.

    Args:
        grey: (H, W).
        per_cell: how many at most in a cell.

    Returns:
        (N, 2) uv px, whole pixels; none in a picture without texture.

    Source: Shi & Tomasi, Good Features to Track, CVPR 1994.
    """
    import cv2

    strength = cv2.cornerMinEigenVal(grey, BLOCK_PX)
    largest_near = cv2.dilate(strength, np.ones((APART_PX, APART_PX), np.uint8))
    weakest = WEAKEST * float(np.quantile(strength, STRONGEST_QUANTILE))
    peak = (strength == largest_near) & (strength > max(weakest, 0.0))
    inside = np.zeros_like(peak)
    inside[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = True
    v, u = np.nonzero(peak & inside)
    side_px = max(BORDER_PX, round((grey.size / CELLS) ** 0.5))
    cell = (v // side_px) * grey.shape[1] + u // side_px
    order = np.lexsort((-strength[v, u], cell))
    cell, v, u = cell[order], v[order], u[order]
    _, first, counts = np.unique(cell, return_index=True, return_counts=True)
    rank = np.arange(len(cell)) - np.repeat(first, counts)
    best = rank < per_cell
    return np.stack([u[best], v[best]], axis=1).astype(np.float32)
