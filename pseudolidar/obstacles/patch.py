"""A flat thing matched as a whole: where the right eye sees its picture, to parts of a pixel.

Matching windows mix a small thing with what is behind it; its own pixels alone do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.grey import grey8_pair, rgb8, shift_to_8_bits
from pseudolidar.geometry.triangulation import (
    corrected_disparity,
    depth_from_disparity,
    depth_per_disparity,
)
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Float32, Float64, Image, UInt8
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig

# Larger things have surfaces of their own in the depth map, more than one shift can tell.
MOST_SIDE_PX = 128
# From this side on, a border of one pixel, which holds the background too, is left out.
BORDER_FROM_PX, LEAST_SIDE_PX = 6, 3
# Levels of grey that a patch must vary by, and the correlation that finds it.
LEAST_CONTRAST, LEAST_CORRELATION = 3.0, 0.75
# A second place that is as good within this makes it unsure, unless it lies beside the first; a
# place whose mean colour differs by so many levels is none.
UNIQUE, BESIDE_PX, COLOUR_LEVELS = 0.04, 2, 12.0
ROUNDS, SMALL_STEP_PX, FARTHEST_PX = 30, 1e-3, 1.5
# Least noise of a picture, levels; errors of neighbours are alike; and what interpolation costs.
LEAST_NOISE, ALIKE, INTERPOLATION_PX = 1.0, 1.5, 0.02


@dataclass(frozen=True)
class PatchDepth:
    """Where a patch is.

    Args:
        depth_m: Z of the flat thing.
        sigma_m: one standard deviation, without what the rig's calibration leaves.
        correlation: with what was found, at most 1.
    """

    depth_m: float
    sigma_m: float
    correlation: float


def patch_depth(sight: Sight, detection: Detection) -> PatchDepth | None:
    """Depth of a small flat thing; None where it is large, plain, or found in several places.

    Source: Lucas & Kanade 1981, along the row, with gain and offset of the brightness.
    """
    window = _window(sight, detection)
    if sight.right is None or sight.rig is None or window is None:
        return None
    rows, columns = window
    left, right = (one.astype(np.float32) for one in grey8_pair(sight.image, sight.right))
    patch, width = left[rows, columns], columns.stop - columns.start
    if float(patch.std()) < LEAST_CONTRAST:
        return None
    left_means, right_means = _mean_colours(sight.image, sight.right, rows, width)
    off = np.abs(right_means - left_means[columns.start]).max(axis=1)
    place = _found(patch, right[rows][:, : columns.stop], off)
    if place is None:
        return None
    at, correlation = place
    off = np.abs(left_means[at:] - right_means[at]).max(axis=1)
    back = _found(right[rows, at : at + width], left[rows][:, at:], off)
    if back is None or abs(at + back[0] - columns.start) > BESIDE_PX:
        return None
    disparity_px = float(columns.start - at)
    refined = _refined(patch, right[rows], columns.start, disparity_px)
    if refined is None:
        return None
    u = 0.5 * (columns.start + columns.stop - 1)
    v = 0.5 * (rows.start + rows.stop - 1)
    return _depth(sight.rig, *refined, u, v, correlation)


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
    return _window_means(left[rows], width), gain * _window_means(right[rows], width)


def _window_means(strip: UInt8, width: int) -> Float64:
    columns = strip.mean(axis=0, dtype=np.float64)
    sums = np.cumsum(np.vstack([np.zeros(columns.shape[1]), columns]), axis=0)
    return np.asarray((sums[width:] - sums[:-width]) / width)


def _found(patch: Float32, strip: Float32, colour_off: Float64) -> tuple[int, float] | None:
    """Column at which the strip looks like the patch most, and how much; None if others do too.

    Args:
        patch: (h, w) grey.
        strip: (h, W) grey.
        colour_off: (W - w + 1 or more,) levels by which the mean colour of a place differs.
    """
    import cv2

    scores = cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED)[0]
    scores[colour_off[: len(scores)] > COLOUR_LEVELS] = -1.0
    best = int(np.argmax(scores))
    others = scores.copy()
    others[max(0, best - BESIDE_PX) : best + BESIDE_PX + 1] = -1.0
    if scores[best] < LEAST_CORRELATION or others.max() > scores[best] - UNIQUE:
        return None
    return best, float(scores[best])


def _refined(
    patch: Float32, strip: Float32, column: int, disparity_px: float
) -> tuple[float, float] | None:
    """Disparity to parts of a pixel, and its error; None where it runs away."""
    target = patch.astype(np.float64)
    d = disparity_px
    for _ in range(ROUNDS):
        seen, slope = _shifted(strip, column - d, patch.shape[1])
        # target = gain seen + offset, and seen moves by -slope for each px of disparity
        columns = np.stack([seen.ravel(), np.ones(seen.size), -slope.ravel()], axis=1)
        normal = np.array([[float((a * b).sum()) for b in columns.T] for a in columns.T])
        right_side = np.array([float((a * target.ravel()).sum()) for a in columns.T])
        try:
            gain, offset, moved = np.linalg.solve(normal, right_side)
        except np.linalg.LinAlgError:
            return None
        if gain <= 0:
            return None
        step = float(np.clip(moved / gain, -0.5, 0.5))
        d += step
        if abs(d - disparity_px) > FARTHEST_PX:
            return None
        if abs(step) < SMALL_STEP_PX:
            break
    left = target - gain * seen - offset - moved * -slope
    noise = max(LEAST_NOISE, float(np.sqrt((left * left).sum() / max(1, left.size - 3))))
    sigma = ALIKE * noise / (gain * float(np.sqrt((slope * slope).sum())))
    return d, float(np.hypot(sigma, INTERPOLATION_PX))


def _shifted(strip: Float32, start: float, width: int) -> tuple[Float64, Float64]:
    """(h, width) of the strip from column `start` on, and how it changes along the row.

    By Catmull and Rom's cubic, exact to the float, where OpenCV rounds places to 1/32 px.
    """
    whole = int(np.floor(start))
    t = start - whole
    last = strip.shape[1] - 1
    taps = [
        strip[:, np.clip(np.arange(whole + k, whole + k + width), 0, last)] for k in (-1, 0, 1, 2)
    ]
    weights = 0.5 * np.array(
        [-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2]
    )
    slopes = 0.5 * np.array(
        [-1 + 4 * t - 3 * t**2, -10 * t + 9 * t**2, 1 + 8 * t - 9 * t**2, 3 * t**2 - 2 * t]
    )
    value = sum(w * tap.astype(np.float64) for w, tap in zip(weights, taps, strict=True))
    slope = sum(w * tap.astype(np.float64) for w, tap in zip(slopes, taps, strict=True))
    return np.asarray(value), np.asarray(slope)


def _depth(
    rig: StereoRig, d: float, sigma_px: float, u: float, v: float, correlation: float
) -> PatchDepth | None:
    at = np.array([d]), np.array([u]), np.array([v])
    true = corrected_disparity(*at, rig)
    depth = depth_from_disparity(true, at[1], rig)
    if not np.isfinite(depth[0]) or depth[0] <= 0:
        return None
    per_px = depth_per_disparity(true, depth, rig)
    return PatchDepth(float(depth[0]), float(sigma_px * per_px[0]), correlation)
