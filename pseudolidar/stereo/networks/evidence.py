"""What a network's disparities are worth: which are hidden or outside, and a sigma of the others.

A network hands over no uncertainty. Sigma is made of what the two pictures and the map itself tell,

    sigma^2 = s^2 (floor^2 + photo^2 + rough^2 + agreement^2)

    photo      r / sqrt(sum Ix^2): error of registering a window whose residual between the eyes is
               r (rms, grey levels) and whose left image has the horizontal gradient Ix; the
               Cramer-Rao bound of a shift
    rough      standard deviation of the disparity in the window about its local plane's level,
               taken from the difference of the map and its mean
    agreement  |d_left - d_right| / sqrt(2), where the mirrored pair was run too
    s          the caller's factor, 1

Source of the bound: Robinson & Milanfar, Fundamental performance limits in image registration, IEEE
TIP 2004. The floor and the weights have no trained network behind them.
"""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Bool, Float32, UInt8
from pseudolidar.structures.disparity import DisparityMap

WINDOW_PX = 7
# Below a twentieth of a pixel no published network was shown to be right.
FLOOR_PX = 0.05
# Rounding to 8 bits alone leaves this much between two views of one surface, grey levels.
_LEAST_RESIDUAL = 1.0
_LEAST_GRADIENT = 1.0  # squared grey levels a window, so that blank windows stay finite
_LARGEST_SIGMA_PX = 10.0
# A pixel is hidden where the pixel that it would match is met by a nearer one.
HIDDEN_STEP_PX = 1.0


def with_evidence(
    left: UInt8,
    right: UInt8,
    disparity: Float32,
    *,
    of_right: Float32 | None,
    agreement_px: float,
    largest_px: float,
    sigma_scale: float,
) -> DisparityMap:
    """Disparities that can be true, with sigma.

    Args:
        left: (H, W) grey.
        right: like left.
        disparity: (H, W) px as the network has it.
        of_right: (H, W) px of the right image, from the mirrored pair, or None.
        agreement_px: largest difference of the two.
        largest_px: largest disparity that is believed.
        sigma_scale: factor on sigma.
    """
    with np.errstate(invalid="ignore"):
        valid = (disparity > 0) & (disparity <= largest_px)
    columns = np.arange(disparity.shape[1], dtype=np.float32)
    target = np.where(valid, columns - disparity, -1)
    valid &= target >= 0
    difference = np.zeros_like(disparity)
    if of_right is None:
        valid &= ~_hidden(disparity, target, valid)
    else:
        difference = np.abs(_sampled(of_right, target) - disparity)
        valid &= difference <= agreement_px
    variance = _photo(left, right, target) ** 2 + _rough(disparity, valid) ** 2
    variance += FLOOR_PX**2 + difference**2 / 2
    sigma = np.minimum(sigma_scale * np.sqrt(variance), _LARGEST_SIGMA_PX)
    nan = np.float32(np.nan)
    return DisparityMap(
        np.where(valid, disparity, nan).astype(np.float32),
        np.where(valid, sigma, nan).astype(np.float32),
    )


def _hidden(disparity: Float32, target: AnyArray, valid: Bool) -> Bool:
    """Pixels whose match is met by another pixel with a larger disparity."""
    height, width = disparity.shape
    rows, columns = np.nonzero(valid)
    met = rows * width + np.rint(target[rows, columns]).astype(np.intp)
    values = disparity[rows, columns]
    nearest = np.zeros(height * width, np.float32)
    order = np.argsort(values, kind="stable")
    nearest[met[order]] = values[order]  # of equal places the last counts: the largest
    hidden = np.zeros(disparity.shape, bool)
    hidden[rows, columns] = nearest[met] - values > HIDDEN_STEP_PX
    return hidden


def _sampled(values: Float32, columns: AnyArray) -> Float32:
    """(H, W) values of the same row at fractional columns; NaN outside."""
    import cv2

    height, width = values.shape
    rows = np.broadcast_to(np.arange(height, dtype=np.float32)[:, None], (height, width))
    return np.asarray(
        cv2.remap(
            values,
            np.asarray(columns, np.float32),
            np.ascontiguousarray(rows),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=float("nan"),
        )
    )


def _photo(left: UInt8, right: UInt8, target: AnyArray) -> Float32:
    import cv2

    window = (WINDOW_PX, WINDOW_PX)
    grey = left.astype(np.float32)
    warped = _sampled(right.astype(np.float32), np.maximum(target, 0))
    residual = grey - np.where(np.isfinite(warped), warped, grey)
    residual -= cv2.blur(residual, window)  # exposure differs between cameras
    power = np.maximum(cv2.blur(residual * residual, window), _LEAST_RESIDUAL)
    gradient = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3) / 8
    slope = cv2.boxFilter(gradient * gradient, cv2.CV_32F, window, normalize=False)
    return np.asarray(np.sqrt(power / (slope + _LEAST_GRADIENT)), np.float32)


def _rough(disparity: Float32, valid: Bool) -> Float32:
    import cv2

    window = (WINDOW_PX, WINDOW_PX)
    known = valid.astype(np.float32)
    count = np.maximum(cv2.blur(known, window), 1e-3)
    level = cv2.blur(np.where(valid, disparity, 0).astype(np.float32), window) / count
    off = np.where(valid, disparity - level, 0)
    # Running sums of a box filter end a little below 0 in flat places.
    variance = np.maximum(cv2.blur((off * off).astype(np.float32), window), 0) / count
    return np.asarray(np.sqrt(variance), np.float32)
