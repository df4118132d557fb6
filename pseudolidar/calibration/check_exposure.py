"""How differently the eyes are exposed: gain, colour, gamma, vignetting, at matched points."""

from __future__ import annotations

import numpy as np

from pseudolidar.calibration.check_finding import Finding
from pseudolidar.calibration.check_matches import PairMatches
from pseudolidar.geometry.photometric import PhotometricDifference, fit_difference
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Bool, Float64, Image

EXPOSURE = "exposure"
LEAST_POINTS = 40
# Side of the patch whose mean is compared, px.
PATCH_PX = 9
# Brightness of the right picture as a share of the left, either way, that gets a warning; and of
# one channel against another. KITTI, Middlebury and rendered worlds have at most 1.06 and 1.03.
WARN_RATIO, WARN_CAST = 1.2, 1.1
# Exponent of one eye's curve against the other's, either way, and the light that one eye's corners
# lose against the other's, that get a warning.
WARN_GAMMA, WARN_CORNERS = 1.2, 0.2
# Patches that touch either end of the range are clipped, and compare nothing; share of the range.
CLIPPED = 0.02
CHANNELS = ("red", "green", "blue")
MEND = (
    "The census matcher does not mind, and for others such pairs are equalised (--balance); better "
    "set both cameras to one exposure, gain, white balance and curve."
)


def exposure_found(left: Image, right: Image, matches: PairMatches, inliers: Bool) -> Finding:
    """Judge the brightness of the right picture against the left."""
    at = matches.left_px[inliers], matches.right_px[inliers]
    means = [_patches(eye, points) for eye, points in zip((left, right), at, strict=True)]
    most = float(np.iinfo(left.dtype).max if left.dtype == np.uint8 else max(left.max(), 1))
    clear = np.all([(m > CLIPPED * most) & (m < (1 - CLIPPED) * most) for m in means], axis=(0, 2))
    n = int(clear.sum())
    if n < LEAST_POINTS:
        return Finding(
            EXPOSURE,
            "unknown",
            f"cannot tell: {n} points that are not clipped",
            figures={"points": n},
        )
    fits = [gain_offset(means[0][clear, c], means[1][clear, c]) for c in range(means[0].shape[1])]
    middle = np.median(means[0][clear], axis=0)
    ratios = np.array(
        [(gain * m + offset) / m for (gain, offset), m in zip(fits, middle, strict=True)]
    )
    figures: dict[str, float | int | None] = {"points": n}
    names = CHANNELS if len(fits) == len(CHANNELS) else ("grey",)
    for name, (gain, offset), ratio in zip(names, fits, ratios, strict=True):
        figures |= {f"gain_{name}": gain, f"offset_{name}": offset, f"ratio_{name}": float(ratio)}
    difference = _difference(left, means, at[1])
    curve, corners = _curve_and_corners(difference)
    known = difference is not None
    figures |= {"gamma": curve if known else None, "vignetting": corners if known else None}
    ratio = float(np.median(ratios))
    cast = float(ratios.max() / max(ratios.min(), 1e-6))
    text = f"the right picture is {ratio:.2f} times as bright as the left one"
    if cast > WARN_CAST:
        text += f", channels differ by {cast:.2f}"
    bent = max(curve, 1 / curve) > WARN_GAMMA
    if bent:
        text += f", its curve has {curve:.2f} times the gamma"
    if abs(corners) > WARN_CORNERS:
        text += f", its corners are {abs(corners):.0%} {'darker' if corners < 0 else 'brighter'}"
    off = max(ratio, 1 / max(ratio, 1e-6)) > WARN_RATIO or cast > WARN_CAST
    if off or bent or abs(corners) > WARN_CORNERS:
        return Finding(EXPOSURE, "warn", text, None, MEND, figures)
    return Finding(EXPOSURE, "good", text, None, "", figures)


def _difference(
    left: Image, means: list[Float64], right_px: Float64
) -> PhotometricDifference | None:
    height, width = left.shape[:2]
    middle = np.array([width - 1, height - 1]) / 2
    radius2 = ((right_px - middle) ** 2).sum(1) / float((middle**2).sum())
    white = float(np.iinfo(left.dtype).max)
    return fit_difference(means[0] / white, means[1] / white, radius2)


def _curve_and_corners(difference: PhotometricDifference | None) -> tuple[float, float]:
    """Ratio of the gammas and the share of light that corners gain; none where nobody knows."""
    if difference is None:
        return 1.0, 0.0
    return difference.gamma, float(np.expm1(difference.vignetting))


def gain_offset(left: Float64, right: Float64) -> tuple[float, float]:
    """Robust line right = gain left + offset; both may be wrong by the same amount.

    Orthogonal regression, reweighted: plain least squares would find less gain in noisier patches.
    """
    weights = np.ones_like(left)
    gain, offset = 1.0, 0.0
    for _ in range(10):
        total = weights.sum()
        x, y = (float((weights * each).sum() / total) for each in (left, right))
        xx, yy, xy = (
            float((weights * a * b).sum())
            for a, b in ((left - x, left - x), (right - y, right - y), (left - x, right - y))
        )
        if xy <= 0:  # one brightness everywhere: no line, only a shift
            return 1.0, y - x
        gain = (yy - xx + float(np.hypot(yy - xx, 2 * xy))) / (2 * xy)
        offset = y - gain * x
        residuals = right - gain * left - offset
        sigma = max(1.0, robust_sigma(residuals))
        weights = 1.0 / (1.0 + (residuals / sigma) ** 2)
    return gain, offset


def _patches(image: Image, points: Float64) -> Float64:
    """(N, C) mean brightness around points."""
    import cv2

    height, width = image.shape[:2]
    smooth = np.asarray(cv2.blur(image, (PATCH_PX, PATCH_PX))).reshape(height, width, -1)
    x = np.clip(np.rint(points[:, 0]), 0, width - 1).astype(int)
    y = np.clip(np.rint(points[:, 1]), 0, height - 1).astype(int)
    return np.asarray(smooth[y, x], np.float64)
