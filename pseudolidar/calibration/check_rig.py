"""Whether the numbers of a rig can be those of the pictures: baseline, focal length, truth."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pseudolidar.calibration.check_epipolar import RowFit
from pseudolidar.calibration.check_finding import SUREST, Finding
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap

BASELINE, FOCAL, TRUTH = "baseline", "focal length", "ground truth"
# Longer than any rig, m: such a number is one of millimetres.
LONGEST_M = 10.0
# Where half of what is matched can be, m.
PLAUSIBLE_M = (0.1, 500.0)
LEAST_POINTS = 30
# Fields of view of lenses that make rectified pictures, degrees.
VIEW_DEG = (5.0, 150.0)
# Rectified pictures have square pixels; cameras as calibrated differ by 0.05 to 3 %, of which
# resizing to whole pixels may make the first quarter of a percent.
UNEQUAL, UNEQUAL_MOST = 0.0025, 0.03
# Two calibrations of the same rectified pictures agree much better than this.
OTHER_FOCAL = 0.02
SET_SCALE = (
    "Set it by a distance that is known, `pseudolidar rectify SOURCE OUT --uncalibrated "
    "--known-distance baseline:0.12` (metres)."
)
SQUEEZED = "Right for pictures that were squeezed; else write the same number twice."
# Disparities of truth and matches agree to this share; the readings a wrong scale comes from.
TRUTH_SHARE, READINGS = 0.1, (16.0, 256.0, 1 / 16, 1 / 256)


def baseline_found(rig: StereoRig, disparity_px: Float64) -> Finding:
    """Judge the baseline by itself and by where it puts what is matched.

    Args:
        rig: of the pair.
        disparity_px: (N,) of its matches.
    """
    baseline_m = rig.baseline_m
    if not rig.metric:
        text = "unknown scale: depths are in a unit that nobody knows, not metres"
        return Finding(BASELINE, "warn", text, None, SET_SCALE, {"baseline_m": None})
    figures: dict[str, float | int | None] = {"baseline_m": baseline_m, "matches": None}
    text = f"{baseline_m:.4g} m"
    mend = "Write lengths of the calibration in metres, or say their unit: --rig-unit mm."
    seen = disparity_px + rig.doffs_px
    seen = seen[seen > 0.5]
    if len(seen) >= LEAST_POINTS:
        depth_m = rig.fB_px_m / float(np.median(seen))
        figures |= {"matches": len(seen), "median_depth_m": depth_m}
        text += f", half of the matches nearer than {depth_m:.3g} m"
    else:
        depth_m = math.nan
    if baseline_m > LONGEST_M:
        sure = SUREST if depth_m > PLAUSIBLE_M[1] else 0.9
        return Finding(BASELINE, "warn", f"{text}: in millimetres?", sure, mend, figures)
    if math.isnan(depth_m):
        return Finding(BASELINE, "good", text, None, "", figures)
    if not PLAUSIBLE_M[0] <= depth_m <= PLAUSIBLE_M[1]:
        right = "times 1000" if depth_m < PLAUSIBLE_M[0] else "as millimetres"
        other_m = depth_m * 1000 if depth_m < PLAUSIBLE_M[0] else depth_m / 1000
        text += f"; {right} it would be {other_m:.3g} m"
        return Finding(BASELINE, "warn", text, 0.9, mend, figures)
    return Finding(BASELINE, "good", text, None, "", figures)


def focal_found(rig: StereoRig, own: StereoRig | None) -> Finding:
    """Judge the focal length: pairs alone cannot show it, other numbers can.

    Args:
        rig: of the pair.
        own: the source's own rig, where `rig` replaces it.
    """
    K = rig.left.K
    fx, fy = float(K[0, 0]), float(K[1, 1])
    view_deg = 2 * math.degrees(math.atan(rig.left.width_px / 2 / fx))
    figures: dict[str, float | int | None] = {"fx_px": fx, "fy_px": fy, "view_deg": view_deg}
    text = f"{fx:.1f} px, a view of {view_deg:.0f} degrees"
    mend = "Give the matrix of the rectified pictures (P, of KITTI P_rect), not the camera's own K."
    if own is not None and own.left.size_px == rig.left.size_px:
        ratio = fx / own.left.focal_px
        figures |= {"own_px": own.left.focal_px}
        if abs(ratio - 1) > OTHER_FOCAL:
            text += f"; the source's own calibration has {own.left.focal_px:.1f} px"
            return Finding(FOCAL, "warn", text, SUREST, mend, figures)
    if not VIEW_DEG[0] <= view_deg <= VIEW_DEG[1]:
        return Finding(FOCAL, "warn", f"{text}: of another image size?", 0.9, mend, figures)
    unequal = abs(fx / fy - 1)
    if UNEQUAL < unequal < UNEQUAL_MOST:
        text += f"; fx and fy differ by {unequal:.2%}, of rectified pictures they are equal"
        return Finding(FOCAL, "warn", text, 0.8, mend, figures)
    if unequal >= UNEQUAL_MOST:
        return _unlike(rig, text, figures)
    return Finding(FOCAL, "good", f"{text}; a pair alone cannot show it", None, "", figures)


def _unlike(rig: StereoRig, text: str, figures: Mapping[str, float | int | None]) -> Finding:
    """Judge pixels that are far from square: squeezed pictures have them, and mistaken matrices."""
    fx, fy = (float(rig.left.K[i, i]) for i in (0, 1))
    width, height = rig.left.size_px
    text += (
        f"; fx {fx:g} and fy {fy:g}: pixels {fx / fy:.3g} times as high as wide. Where they are "
        f"square, fy is {fx:g}, and heights are told {fx / fy:.3g} times too large"
    )
    if abs(fx / fy * height / width - 1) > OTHER_FOCAL:
        return Finding(FOCAL, "note", text, None, SQUEEZED, figures)
    text += f". They are as {width} to {height}, the size of the picture, which no lens makes"
    return Finding(FOCAL, "warn", text, 0.9, f"Write {fx:g} in place of {fy:g}.", figures)


def truth_found(fit: RowFit | None, truth: DisparityMap) -> Finding:
    """Judge the scale of ground-truth disparities by matches, which know nothing of it."""
    ratios = np.zeros(0) if fit is None else _ratios(fit, truth)
    if len(ratios) < LEAST_POINTS:
        return Finding(
            TRUTH,
            "unknown",
            f"cannot tell: {len(ratios)} matches have one",
            figures={"matches": len(ratios)},
        )
    ratio = float(np.median(ratios))
    figures: dict[str, float | int | None] = {"matches": len(ratios), "of_matches": ratio}
    text = f"disparities of the truth are {ratio:.3g} times those of {len(ratios)} matches"
    if abs(ratio - 1) < TRUTH_SHARE:
        return Finding(TRUTH, "good", text, None, "", figures)
    reading = min(READINGS, key=lambda factor: abs(math.log(ratio / factor)))
    if abs(math.log(ratio / reading)) < TRUTH_SHARE:
        scale = f"x {reading:g}" if reading > 1 else f"/ {1 / reading:g}"
        mend = "Store disparities in the scale that their format has (KITTI's PNG: px x 256)."
        return Finding(TRUTH, "warn", f"{text}: stored {scale}", SUREST, mend, figures)
    return Finding(
        TRUTH, "warn", text, 0.9, "Check that the truth belongs to these pictures.", figures
    )


def _ratios(fit: RowFit, truth: DisparityMap) -> Float64:
    at = np.rint(fit.matches.left_px[fit.inliers]).astype(int)
    height, width = truth.values.shape
    x, y = np.clip(at[:, 0], 0, width - 1), np.clip(at[:, 1], 0, height - 1)
    d, matched = truth.values[y, x].astype(np.float64), fit.matches.disparity_px[fit.inliers]
    known = np.isfinite(d) & (matched > 2.0) & (d > 0)
    return np.asarray(d[known] / matched[known])
