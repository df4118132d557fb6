"""Arrays as pictures: disparity, error and top view in colours that mean the same everywhere."""

from __future__ import annotations

import numpy as np

from pseudolidar.evaluation.disparity import D1_PX, D1_REL
from pseudolidar.structures.arrays import AnyArray, Float32, UInt8

# Colour of pixels without a value.
NOTHING = (24, 24, 28)
# Error colours: each step doubles the error, blue within the D1 threshold and red outside it, as in
# the error images of the KITTI stereo benchmark. Upper limits in units of the threshold.
ERROR_STEPS = (0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, np.inf)
ERROR_COLOURS = (
    (49, 54, 149),
    (69, 117, 180),
    (116, 173, 209),
    (171, 217, 233),
    (224, 243, 248),
    (254, 224, 144),
    (253, 174, 97),
    (244, 109, 67),
    (215, 48, 39),
    (165, 0, 38),
)


def turbo(values: AnyArray, low: float, high: float) -> UInt8:
    """(..., 3) RGB of `values` between `low` (blue) and `high` (red); NaN is nearly black."""
    import cv2

    scaled = np.clip((np.asarray(values, np.float32) - low) / max(high - low, 1e-9), 0, 1)
    levels = np.where(np.isfinite(scaled), 255 * scaled, 0).astype(np.uint8)
    if not levels.size:  # of which OpenCV makes nothing
        return np.zeros((*levels.shape, 3), np.uint8)
    bgr = cv2.applyColorMap(levels.reshape(-1, 1), cv2.COLORMAP_TURBO)
    picture = bgr[:, 0, ::-1].reshape(*levels.shape, 3).copy()
    picture[~np.isfinite(values)] = NOTHING
    return np.asarray(picture, np.uint8)


def disparity_picture(disparity: Float32, max_px: float) -> UInt8:
    """(H, W, 3) RGB: near is red, far is blue, none is nearly black."""
    return turbo(disparity, 0.0, max_px)


def error_picture(disparity: Float32, truth: Float32) -> UInt8:
    """(H, W, 3) RGB of the disparity error where truth exists: blue is within D1's limit, red not.

    Pixels with truth but without a disparity are white. Each pixel of a sparse truth also fills its
    empty neighbours, the worst of them wins, so that it can be seen.

    Source: KITTI stereo 2015, error images of the development kit.
    """
    known = np.isfinite(truth)
    threshold = np.maximum(D1_PX, D1_REL * np.nan_to_num(truth))
    error = np.nan_to_num(np.abs(disparity - truth) / threshold)
    steps = np.searchsorted(ERROR_STEPS, error, side="left").astype(np.float32)
    steps[known & ~np.isfinite(disparity)] = len(ERROR_COLOURS)
    steps[~known] = np.nan
    palette = np.array([*ERROR_COLOURS, (255, 255, 255), NOTHING], np.uint8)
    filled = _empty_neighbours_filled(steps)
    codes = np.where(np.isfinite(filled), filled, len(palette) - 1)
    return np.asarray(palette[codes.astype(np.intp)], np.uint8)


def _empty_neighbours_filled(values: Float32) -> Float32:
    import cv2

    known = np.isfinite(values)
    lowest = np.where(known, values, -1).astype(np.float32)
    grown = np.asarray(cv2.dilate(lowest, np.ones((3, 3), np.uint8)), np.float32)
    grown[grown < 0] = np.nan
    return np.where(known, values, grown)


def top_picture(counts: AnyArray) -> UInt8:
    """(rows, columns, 3) RGB of points per square seen from above, brighter with more of them."""
    amount = np.log1p(counts.astype(np.float32))
    bright = amount / max(float(np.quantile(amount, 0.995)), 1.0)
    return turbo(np.where(counts > 0, 0.15 + 0.75 * bright, np.nan), 0.0, 1.0)


def thicker(picture: UInt8, times: int) -> UInt8:
    """Each pixel as a square of `times` x `times`; nothing is blended."""
    return np.asarray(picture.repeat(times, axis=0).repeat(times, axis=1), np.uint8)
