"""A flat thing matched as a whole: where the right eye sees its picture, to parts of a pixel.

Matching windows mix a small thing with what is behind it; its own pixels alone do not.
"""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.grey import grey8_pair, rgb8, shift_to_8_bits
from pseudolidar.obstacles.patch_matching import PatchDepth, matched_patch, window_means
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Float64, Image
from pseudolidar.structures.box import Detection

# Larger things have surfaces of their own in the depth map, more than one shift can tell.
MOST_SIDE_PX = 128
# From this side on, a border of one pixel, which holds the background too, is left out.
BORDER_FROM_PX, LEAST_SIDE_PX = 6, 3
# Levels of grey that a patch must vary by.
LEAST_CONTRAST = 3.0


def patch_depth(sight: Sight, detection: Detection) -> PatchDepth | None:
    """Depth of a small flat thing; None where it is large, plain, or found in several places."""
    window = _window(sight, detection)
    if sight.right is None or sight.rig is None or window is None:
        return None
    rows, columns = window
    left, right = (one.astype(np.float32) for one in grey8_pair(sight.image, sight.right))
    if float(left[rows, columns].std()) < LEAST_CONTRAST:
        return None
    width = columns.stop - columns.start
    means = _mean_colours(sight.image, sight.right, rows, width)
    return matched_patch(left, right, window, sight.rig, means)


def _window(sight: Sight, detection: Detection) -> tuple[slice, slice] | None:
    """Whole pixels inside of the box."""
    left, top, right, bottom = detection.box_px
    width, height = sight.camera.size_px

    def inner(low: float, high: float, size: int) -> slice | None:
        first, last = int(np.ceil(max(low, 0.0))), int(np.floor(min(high, size - 1.0)))
        if last - first + 1 >= BORDER_FROM_PX:
            first, last = first + 1, last - 1
        good = LEAST_SIDE_PX <= last - first + 1 <= MOST_SIDE_PX
        return slice(first, last + 1) if good else None

    rows, columns = inner(top, bottom, height), inner(left, right, width)
    return None if rows is None or columns is None else (rows, columns)


def _mean_colours(image: Image, other: Image, rows: slice, width: int) -> tuple[Float64, Float64]:
    """(W - width + 1, 3) mean of each window of these rows in the left and in the right picture.

    In 8 bits, the right picture as bright in every colour, on the whole, as the left one.
    """
    shift = shift_to_8_bits(image, other)
    left, right = (rgb8(eye, shift) for eye in (image, other))
    gain = left.mean(axis=(0, 1)) / np.maximum(right.mean(axis=(0, 1)), 1.0)
    return window_means(left[rows], width), gain * window_means(right[rows], width)
