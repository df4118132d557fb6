"""Rows of a pair brought to the same height."""

from __future__ import annotations

import functools
from typing import cast

import numpy as np

from pseudolidar.structures.arrays import Float32, Image
from pseudolidar.structures.correction import RowCorrection

# Fields of so many rigs or sizes are kept: making one takes longer than using it.
FIELDS_KEPT = 4


def rows_aligned(right: Image, rows: RowCorrection) -> Image:
    """The right picture of a pair, moved along its columns so that rows meet those of the left one.

    Cubic between pixels. What would come from above or below the picture is black: nothing is
    invented, and a matcher finds nothing there.

    Args:
        right: (H, W) or (H, W, 3), uint8 or uint16.
        rows: what to put right.
    """
    import cv2

    height, width = right.shape[:2]
    u, v = _field(tuple(rows.coefficients.tolist()), width, height)
    aligned = cv2.remap(right, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    aligned[(v < 0) | (v > height - 1)] = 0
    return cast("Image", aligned)


@functools.lru_cache(FIELDS_KEPT)
def _field(coefficients: tuple[float, ...], width: int, height: int) -> tuple[Float32, Float32]:
    """(H, W) columns and rows of the right picture that its aligned pixels come from."""
    v, u = np.indices((height, width), np.float64)
    lower = RowCorrection(np.array(coefficients), 0.0).offset_px(u, v, (width, height))
    return u.astype(np.float32), (v + lower).astype(np.float32)
