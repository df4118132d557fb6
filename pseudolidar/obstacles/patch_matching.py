"""Where the right eye sees a part of the left picture, to parts of a pixel, there and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.triangulation import (
    corrected_disparity,
    depth_from_disparity,
    depth_per_disparity,
)
from pseudolidar.structures.arrays import AnyArray, Float32, Float64
from pseudolidar.structures.camera import StereoRig

# The correlation that finds a patch.
LEAST_CORRELATION = 0.75
# A second place that is as good within this makes it unsure, unless it lies beside the first; a
# place whose mean colour differs by so many levels is none.
UNIQUE, BESIDE_PX, COLOUR_LEVELS = 0.04, 2, 12.0
ROUNDS, SMALL_STEP_PX, FARTHEST_PX = 30, 1e-3, 1.5
# Levels of a picture, of which grey ones have 256.
LEVELS = 255.0
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


def matched_patch(
    left: Float32,
    right: Float32,
    window: tuple[slice, slice],
    rig: StereoRig,
    means: tuple[Float64, Float64],
) -> PatchDepth | None:
    """Depth of a window of the left picture; None where it is found nowhere, or in several places.

    Args:
        left: (H, W) grey levels.
        right: (H, W) likewise.
        window: rows and columns.
        rig: of the pictures.
        means: as in `there_and_back`.

    Source: Lucas & Kanade 1981, along the row, with gain and offset of the brightness.
    """
    rows, columns = window
    place = there_and_back(left, right, window, means)
    if place is None:
        return None
    at, correlation = place
    patch = left[rows, columns]
    refined = _refined(patch, right[rows], columns.start, float(columns.start - at))
    return None if refined is None else depth_of_match(rig, *refined, window, correlation)


def there_and_back(
    left: Float32,
    right: Float32,
    window: tuple[slice, slice],
    means: tuple[Float64, Float64],
    *,
    beside_px: int = BESIDE_PX,
) -> tuple[int, float] | None:
    """The column of the right picture at which a window of the left one begins, and how alike.

    Args:
        left: (H, W) grey levels, or any other picture of as many levels.
        right: (H, W) likewise.
        window: rows and columns.
        means: (W - w + 1, C) means of the windows of these rows in both pictures, such as of their
            colours: where they differ is no place.
        beside_px: within so much of the best place, others may be as good.

    Returns:
        None where it is found nowhere or in several places, or is not found from there again.
    """
    rows, columns = window
    off = np.abs(means[1] - means[0][columns.start]).max(axis=1)
    place = _found(left[rows, columns], right[rows][:, : columns.stop], off, beside_px)
    if place is None:
        return None
    at, correlation = place
    off = np.abs(means[0][at:] - means[1][at]).max(axis=1)
    width = columns.stop - columns.start
    back = _found(right[rows, at : at + width], left[rows][:, at:], off, beside_px)
    if back is None or abs(at + back[0] - columns.start) > BESIDE_PX:
        return None
    return at, correlation


def window_means(strip: AnyArray, width: int) -> Float64:
    """(W - width + 1, C) means of all windows of a strip (h, W, C)."""
    columns = strip.mean(axis=0, dtype=np.float64)
    sums = np.cumsum(np.vstack([np.zeros(columns.shape[1]), columns]), axis=0)
    return np.asarray((sums[width:] - sums[:-width]) / width)


def _found(
    patch: Float32, strip: Float32, colour_off: Float64, beside_px: int
) -> tuple[int, float] | None:
    """Column at which the strip looks like the patch most, and how much; None if others do too.

    Args:
        patch: (h, w) grey.
        strip: (h, W) grey.
        colour_off: (W - w + 1 or more,) levels by which the mean colour of a place differs.
        beside_px: so near to the best place another one is the same.
    """
    import cv2

    scores = cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED)[0]
    scores[colour_off[: len(scores)] > COLOUR_LEVELS] = -1.0
    best = int(np.argmax(scores))
    others = scores.copy()
    others[max(0, best - beside_px) : best + beside_px + 1] = -1.0
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


def depth_of_match(
    rig: StereoRig,
    disparity_px: float,
    sigma_px: float,
    window: tuple[slice, slice],
    correlation: float,
) -> PatchDepth | None:
    """Where a window is that was found at a disparity; None beyond infinity.

    Args:
        rig: of the pictures.
        disparity_px: as measured.
        sigma_px: of that.
        window: rows and columns.
        correlation: with what was found.
    """
    rows, columns = window
    u = np.array([0.5 * (columns.start + columns.stop - 1)])
    v = np.array([0.5 * (rows.start + rows.stop - 1)])
    true = corrected_disparity(np.array([disparity_px]), u, v, rig)
    depth = depth_from_disparity(true, u, rig)
    if not np.isfinite(depth[0]) or depth[0] <= 0:
        return None
    per_px = depth_per_disparity(true, depth, rig)
    return PatchDepth(float(depth[0]), float(sigma_px * per_px[0]), min(correlation, 1.0))
