"""Whether rows of the two pictures correspond: shift, roll, scale, tilt of the baseline."""

from __future__ import annotations

import numpy as np

from pseudolidar.calibration.check_epipolar import RowFit
from pseudolidar.calibration.check_finding import Finding, sure_beyond

ROWS = "rows"
# Matches that must agree, their share, and the parts of the picture they must cover: fewer say
# nothing about the rig. KITTI, Middlebury and rendered pairs have 300 to 1300, 0.86 to 1.00, 40 up.
LEAST_INLIERS, LEAST_SHARE, LEAST_CELLS = 40, 0.5, 10
# Error of the fit beyond which it tells nothing.
MOST_SIGMA_PX = 0.35
# Rows that are off by so much stop a run: beyond 1 px matchers fail (at 3 px 14 % of SGBM's pixels
# are right), KITTI's own rectification leaves 0.5 px.
STOP_PX, WARN_PX = 1.0, 0.6
# Small pictures: a roll is seen before it makes that much.
STOP_ROLL_DEG, STOP_ROLL_PX = 0.35, 0.4
# Matches that are off by less than this share of what a fit to them says contradict it: of
# a repeating pattern (chessboard, 0.19 px, fit 1.68).
EXTRAPOLATED = 1 / 3
# What is worth a word in the explanation.
SAID_PX, SAID_DEG, SAID_SHARE, SAID_DIRECTION = 0.5, 0.1, 0.004, 0.03
# Rows of rectified pictures that are off by so much at most are put right by a row correction.
CORRECTED_PX = 6.0
CORRECT = (
    "Fit the rows, `pseudolidar refine SOURCE --by rows --out rig.json`, and pass --rig rig.json; "
    "or rectify the pictures anew. --no-check takes them as they are."
)
RECTIFY = (
    "Rectify the pictures with the calibration they were taken with, or give the rig that fits "
    "them (--rig). --no-check takes them as they are."
)


def enough(fit: RowFit | None) -> bool:
    """Whether a fit says anything about the rig."""
    return (
        fit is not None
        and int(fit.inliers.sum()) >= LEAST_INLIERS
        and fit.inlier_share >= LEAST_SHARE
        and len(fit.cells) >= LEAST_CELLS
        and fit.typical_sigma_px <= MOST_SIGMA_PX
    )


def rows_found(fit: RowFit | None, *, matches: int) -> Finding:
    """Judge the rows of a pair by the model fitted to its matches.

    Args:
        fit: with or without the direction from eye to eye, whichever explains the pair.
        matches: how many there are, for pairs without a fit.
    """
    if fit is None or not enough(fit):
        agreeing = 0 if fit is None else int(fit.inliers.sum())
        return Finding(
            ROWS,
            "unknown",
            f"cannot tell: {matches} matches, of which {agreeing} agree, are too few or too close",
            figures={"matches": matches, "inliers": agreeing},
        )
    typical_px, sigma_px = fit.typical_px, fit.typical_sigma_px
    own_px = float(np.median(np.abs(fit.matches.row_difference_px[fit.inliers])))
    if own_px < EXTRAPOLATED * typical_px and typical_px > WARN_PX:
        return Finding(
            ROWS,
            "unknown",
            f"cannot tell: matches are {own_px:.2f} px off, and a fit to them says "
            f"{typical_px:.2f}: a pattern that repeats, or too few things",
            figures={"matches": matches, "inliers": int(fit.inliers.sum())},
        )
    figures: dict[str, float | int | None] = {
        "matches": matches,
        "inliers": int(fit.inliers.sum()),
        "typical_px": typical_px,
        "sigma_px": sigma_px,
        "offset_px": fit.offset_px,
        "roll_deg": fit.roll_deg,
        "scale": fit.scale,
    }
    seen = f"typically {typical_px:.2f} px off"
    cause, mend = causes(fit), CORRECT if typical_px < CORRECTED_PX else RECTIFY
    rolled = (
        abs(fit.roll_deg) - 2.0 * fit.roll_sigma_deg > STOP_ROLL_DEG and typical_px > STOP_ROLL_PX
    )
    if typical_px > STOP_PX or rolled:
        sure = sure_beyond(typical_px, STOP_PX, sigma_px)
        if rolled:
            sure = max(sure, sure_beyond(abs(fit.roll_deg), STOP_ROLL_DEG, fit.roll_sigma_deg))
        return Finding(ROWS, "stop", f"{seen}: {cause}", sure, mend, figures)
    sure = sure_beyond(typical_px, STOP_PX, sigma_px)
    if typical_px > WARN_PX:
        return Finding(ROWS, "warn", f"{seen}: {cause}", sure, mend, figures)
    return Finding(ROWS, "good", seen, sure, "", figures)


def causes(fit: RowFit) -> str:
    """What the row differences look like, the greatest first."""
    width, height = fit.matches.size_px
    t_y, _ = fit.direction
    parts = [
        (
            abs(fit.offset_px),
            abs(fit.offset_px) > SAID_PX,
            f"the right picture lies {abs(fit.offset_px):.1f} px "
            + ("lower" if fit.offset_px > 0 else "higher"),
        ),
        (
            abs(fit.coefficients[1]) / fit.focal_px * width / 4,
            abs(fit.roll_deg) > SAID_DEG,
            f"it is rolled by {abs(fit.roll_deg):.2f} degrees "
            + ("clockwise" if fit.roll_deg > 0 else "anticlockwise"),
        ),
        (
            abs(fit.scale) * height / 4,
            abs(fit.scale) > SAID_SHARE,
            f"it is {abs(fit.scale):.1%} {'larger' if fit.scale > 0 else 'smaller'}",
        ),
        (
            abs(t_y) * 50.0,
            abs(t_y) > SAID_DIRECTION,
            f"the eyes do not stand side by side ({abs(t_y):.0%} of the baseline up or down)",
        ),
    ]
    said = [text for _, worth, text in sorted(parts, reverse=True) if worth]
    return ", ".join(said) or "by parts of the picture"
