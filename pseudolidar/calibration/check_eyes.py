"""Whether left is left: by the side on which near things move from one picture to the other."""

from __future__ import annotations

import math

import numpy as np

from pseudolidar.calibration.check_finding import SUREST, Finding
from pseudolidar.structures.arrays import Float64, Image

EYES, SAME = "eyes", "same picture"
# A match lies behind infinity where its disparity is negative by more than this.
BEHIND_PX = 1.0
LEAST_INLIERS = 20
# Share of the matches that one reading must put behind infinity, and the other may. Swapped pairs
# of KITTI, Middlebury and rendered worlds have 0.74 and more, right ones 0.005 and less.
IMPOSSIBLE, POSSIBLE = 0.25, 0.05
# Matches of one clump, and its odds for either reading. Fewer behind infinity are chance, such as
# squares of a board that are taken for one another.
CLUMP, CLUMP_ODDS = 10.0, 20.0
# The same picture stored twice, in another format: nine of ten matches do not move, and its pixels
# agree. Pictures of two eyes correlate by 0.55 to 0.94, and what is near moves.
SAME_PX, SAME_SHARE, SAME_CORRELATION = 0.25, 0.9, 0.98


def eyes_found(disparity_px: Float64, doffs_px: float) -> Finding:
    """Judge which picture is which.

    Args:
        disparity_px: (N,) of the matches that agree on how rows differ.
        doffs_px: of the rig; a point at infinity has disparity `-doffs_px`.
    """
    n = len(disparity_px)
    if n < LEAST_INLIERS:
        return Finding(EYES, "unknown", f"cannot tell: {n} matches", figures={"matches": n})
    behind = int(np.sum(disparity_px + doffs_px < -BEHIND_PX))
    swapped = int(np.sum(-disparity_px + doffs_px < -BEHIND_PX))
    share, other = behind / n, swapped / n
    median_px = float(np.median(disparity_px))
    figures: dict[str, float | int | None] = {
        "matches": n,
        "behind_infinity": share,
        "behind_infinity_if_swapped": other,
        "median_disparity_px": median_px,
    }
    odds = abs(swapped - behind) / CLUMP * math.log(CLUMP_ODDS)
    sure = min(SUREST, 1.0 / (1.0 + math.exp(-min(odds, 50.0))))
    if share > IMPOSSIBLE and other < POSSIBLE:
        return Finding(
            EYES,
            "stop",
            f"left and right are swapped: {share:.0%} of {n} matches lie behind infinity, "
            f"swapped {other:.0%} would",
            sure,
            "Pass --swap.",
            figures,
        )
    if share > POSSIBLE and behind >= CLUMP:
        return Finding(
            EYES,
            "warn",
            f"{share:.0%} of {n} matches lie behind infinity, swapped {other:.0%} would: the "
            "principal points are not those of these pictures",
            sure if share > IMPOSSIBLE else None,
            "Give the rig of these pictures (--rig).",
            figures,
        )
    if other < IMPOSSIBLE:
        return Finding(
            EYES, "unknown", "cannot tell: nothing near enough is seen", None, "", figures
        )
    return Finding(
        EYES, "good", f"left is left: {other:.0%} of {n} matches say so", sure, "", figures
    )


def same_found(left: Image, right: Image, moves_px: Float64) -> Finding:
    """Judge whether both pictures are one.

    Args:
        left: the left picture.
        right: the right one.
        moves_px: (N,) how far each match moves.
    """
    fix = "Check that both sides are not of the same camera."
    if np.array_equal(left, right):
        return Finding(SAME, "warn", "left and right are the same picture", 1.0, fix)
    if len(moves_px) >= LEAST_INLIERS and float(np.quantile(moves_px, SAME_SHARE)) < SAME_PX:
        alike = correlation(left, right)
        if alike > SAME_CORRELATION:
            return Finding(
                SAME,
                "warn",
                f"left and right are the same picture, stored twice: {len(moves_px)} matches do "
                f"not move, the pixels correlate by {alike:.4f}",
                SUREST,
                fix,
                {"matches": len(moves_px), "correlation": alike},
            )
    return Finding(SAME, "good", "two pictures")


def correlation(left: Image, right: Image) -> float:
    """Pearson's, of all pixels; NaN of an even picture."""
    a, b = (eye.astype(np.float32).ravel() for eye in (left, right))
    a, b = a - a.mean(dtype=np.float64), b - b.mean(dtype=np.float64)
    scale = math.sqrt(float(np.sum(a * a)) * float(np.sum(b * b)))
    return float(np.sum(a * b)) / scale if scale > 0 else float("nan")
