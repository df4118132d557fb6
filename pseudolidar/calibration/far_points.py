"""Distant points, whose disparities tell when a rig is impossible: nothing is beyond infinity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.geometry.corners import spread_corners
from pseudolidar.geometry.lucas_kanade import follow_both_ways
from pseudolidar.geometry.pnp import TRACK_SIGMA_PX
from pseudolidar.geometry.tracking import (
    CORNERS_FIRST,
    LEVELS_FIRST,
    MAX_ROWS_PX,
    RETURNS_FIRST_PX,
    WINDOW_ACROSS_PX,
    WINDOW_OVER_TIME_PX,
    MatchedPair,
)
from pseudolidar.structures.arrays import Bool, Float32, Float64
from pseudolidar.structures.camera import StereoRig

# Distant is what has less disparity (plus doffs) than this, px: 190 m on KITTI. Noise and offsets
# of rigs are smaller, so that both signs come in as they are.
FAR_PX = 2.0
# A point found over time is right to this, px.
FOUND_PX = 0.5
# Fewer points are no evidence.
MIN_POINTS = 50
# Of points at infinity itself, a tenth is found this far beyond it by noise alone, px: 1.28 sigma.
NOISE_TENTH_PX = 1.28 * TRACK_SIGMA_PX
# The rest of it is impossible, from this on, px.
IMPOSSIBLE_PX = 0.1


@dataclass(frozen=True)
class FarPoints:
    """What the distant points of a sequence say.

    Args:
        n: how many were measured.
        beyond_share: how many of them lie beyond infinity: disparity below `-doffs`.
        tenth_px: a tenth of them have less disparity than this, plus doffs; 0 is infinity.
    """

    n: int
    beyond_share: float | None
    tenth_px: float | None

    @classmethod
    def of(cls, disparities: Sequence[Float64]) -> FarPoints:
        """Of the points of all pairs, disparities plus doffs, px."""
        d = np.concatenate([*disparities, np.zeros(0)])
        if not len(d):
            return cls(0, None, None)
        return cls(len(d), float(np.mean(d < 0)), float(np.quantile(d, 0.1)))

    @property
    def too_small_px(self) -> float:
        """By how much disparities are too small at least; 0 where noise explains all."""
        if self.n < MIN_POINTS or self.tenth_px is None:
            return 0.0
        beyond_px = -self.tenth_px - NOISE_TENTH_PX
        return beyond_px if beyond_px > IMPOSSIBLE_PX else 0.0

    @property
    def conclusion(self) -> str:
        """In words."""
        if self.n < MIN_POINTS or self.beyond_share is None:
            return f"distant points: {self.n}, too few to tell whether any lie beyond infinity"
        seen = f"distant points: {self.beyond_share:.0%} of {self.n} lie beyond infinity"
        if not self.too_small_px:
            return f"{seen}, no more than noise explains"
        return (
            f"{seen}, impossible: disparities are too small by {self.too_small_px:.2f} px or more"
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "n": self.n,
            "beyond_infinity": self.beyond_share,
            "tenth_px": self.tenth_px,
            "too_small_px": self.too_small_px,
        }


def far_disparities(
    first: MatchedPair, second: MatchedPair, rig: StereoRig, T_to_from: Float64
) -> Float64:
    """Disparities, plus doffs, of the distant points of a pair, measured without a matcher.

    A point counts as distant, and at rest, where it moves between two pairs as the camera's
    rotation alone moves it, up to what its translation does at the edge of far.

    Args:
        first: the earlier pair.
        second: the next one.
        rig: rectified.
        T_to_from: (4, 4) how the camera moved.

    Returns:
        (N,) px; negative is beyond infinity.
    """
    uv = spread_corners(first.left, per_cell=CORNERS_FIRST)
    above = first.disparity_at(uv) + np.float32(rig.doffs_px)
    uv, above = (column[~(above > 2 * FAR_PX)] for column in (uv, above))
    start = np.nan_to_num(above, nan=0.0) - np.float32(rig.doffs_px)
    guess = np.column_stack([uv[:, 0] - start, uv[:, 1]]).astype(np.float32)
    in_right, found = follow_both_ways(
        first.left,
        first.right,
        uv,
        guess,
        window_px=WINDOW_ACROSS_PX,
        within_px=RETURNS_FIRST_PX,
    )
    shift = (uv - in_right).astype(np.float64)
    d = shift[:, 0] + rig.doffs_px
    found &= (np.abs(shift[:, 1]) < MAX_ROWS_PX) & (np.abs(d) < FAR_PX)
    uv, d = uv[found], d[found]
    return d[_at_rest_far_away(first, second, uv, rig, T_to_from)]


def _at_rest_far_away(
    first: MatchedPair, second: MatchedPair, uv: Float32, rig: StereoRig, T_to_from: Float64
) -> Bool:
    """(N,) which points the rotation alone explains."""
    K, R, t = rig.left.K, T_to_from[:3, :3], T_to_from[:3, 3]
    rays = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(K).T @ R.T
    turned = rays / rays[:, 2:]
    at_infinity = (turned @ K.T)[:, :2]
    there, found = follow_both_ways(
        first.left,
        second.left,
        uv,
        at_infinity.astype(np.float32),
        window_px=WINDOW_OVER_TIME_PX,
        levels=LEVELS_FIRST,
        within_px=RETURNS_FIRST_PX,
    )
    nearest_m = rig.fB_px_m / FAR_PX
    by_translation = rig.left.focal_px * np.linalg.norm(t[:2] - turned[:, :2] * t[2], axis=1)
    moved = np.linalg.norm(there - at_infinity, axis=1)
    return np.asarray(found & (moved < by_translation / nearest_m + FOUND_PX))
