"""Whether there is anything to be matched in a box: by how much its grey changes along the rows."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.grey import grey8_of
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.box import Detection

# Noise of a picture, levels of grey; differences of neighbours have twice its variance.
NOISE_LEVELS = 1.0


def row_texture(sight: Sight, detection: Detection) -> float:
    """0-1: the part of a box's changes from pixel to pixel along its rows that noise does not make.

    Shading and noise alone give 0: whatever was matched there, it was not what is in the box.
    """
    height, width = sight.image.shape[:2]
    left, top, right, bottom = detection.box_px
    rows = slice(int(np.clip(np.ceil(top), 0, height)), int(np.clip(bottom + 1, 0, height)))
    columns = slice(int(np.clip(np.ceil(left), 0, width)), int(np.clip(right + 1, 0, width)))
    window = sight.image[rows, columns]
    if window.shape[0] < 1 or window.shape[1] < 2:
        return 0.0
    steps = np.diff(grey8_of(window).astype(np.float64), axis=1)
    energy = float((steps * steps).mean())
    return max(0.0, 1.0 - 2.0 * NOISE_LEVELS**2 / energy) if energy > 0 else 0.0
