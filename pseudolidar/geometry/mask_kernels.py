"""Disparities of pixels that show nothing, taken out in place."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray


@njit(
    "void(float32[:, ::1], float32[:, ::1], boolean[:, ::1], boolean[:, ::1])",
    nogil=True,
    cache=True,
)
def drop_unshown(values: AnyArray, sigma: AnyArray, left: AnyArray, right: AnyArray) -> None:
    """NaN where the left pixel, or the right one that it was matched with, shows nothing.

    Args:
        values: (H, W) float32 px, changed.
        sigma: the same, or (0, 0) where there is none; changed.
        left: (H, W) bool pixels of the left picture that show something.
        right: (H, W) bool of the right one.
    """
    height, width = values.shape
    for row in range(height):
        for column in range(width):
            d = np.float64(values[row, column])
            if math.isfinite(d) and left[row, column]:
                match = np.rint(column - d)
                if 0 <= match < width and right[row, int(match)]:
                    continue
            values[row, column] = np.float32(np.nan)
            if sigma.shape[0] > 0:
                sigma[row, column] = np.float32(np.nan)
