"""Rows of a pair brought to the same height."""

from __future__ import annotations

from typing import cast

import numpy as np

from pseudolidar.structures.arrays import Float32, Image
from pseudolidar.structures.correction import RowCorrection


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
    v = rows.field_px(width, height)
    v += np.arange(height, dtype=np.float32)[:, None]
    u = np.broadcast_to(np.arange(width, dtype=np.float32), v.shape)
    moved = cv2.remap(
        right, np.ascontiguousarray(u), v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    aligned = cast("Image", moved)
    _blacken(aligned, v)
    return aligned


def _blacken(aligned: Image, v: Float32) -> None:
    """Where rows `v` (H, W) are none of the picture, near its upper and lower edge."""
    height = len(v)
    rows = np.flatnonzero((v.min(axis=1) < 0) | (v.max(axis=1) > height - 1))
    for row in rows:
        aligned[row, (v[row] < 0) | (v[row] > height - 1)] = 0
