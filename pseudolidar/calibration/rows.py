"""The smooth difference of rows that rectification left, from points that both eyes see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.geometry.corners import spread_corners
from pseudolidar.geometry.gaps import filled
from pseudolidar.geometry.lucas_kanade import follow_both_ways
from pseudolidar.geometry.row_fit import LEAST_GAIN, fitted_rows, one_sigma, row_offsets
from pseudolidar.geometry.tracking import CORNERS_PRECISE, WINDOW_ACROSS_PX, MatchedPair
from pseudolidar.structures.arrays import Bool, Float64, Int64
from pseudolidar.structures.correction import RowCorrection

# A point found in the other eye comes back to this, and lies within so many rows, px; a pair that
# is off by more is not rectified.
RETURNS_PX, MOST_ROWS_PX = 0.3, 4.0
# Its disparity is not farther from the matched one, px.
MOST_FROM_MATCHED_PX = 2.0
# Frames and points without which nothing can be fitted and judged on frames left out.
MIN_FRAMES, MIN_POINTS = 3, 500
FOLDS = 5
# The image is divided into 6 x 3 blocks. With points in fewer of them than this share a polynomial
# would be free elsewhere.
BLOCKS, LEAST_COVERED, LEAST_IN_BLOCK = (6, 3), 0.6, 10
# How many independent points a frame is worth: neighbours share their picture's errors.
INDEPENDENT_PER_FRAME = 100


@dataclass(frozen=True)
class Rows:
    """From points that both eyes see: the rows of the pictures alone, of any pairs of one rig.

    Args:
        most: frames that points are taken from, evenly.
    """

    most: int = 40

    def __post_init__(self) -> None:
        if self.most < MIN_FRAMES:
            raise UsageError(
                f"most {self.most}",
                want=f"{MIN_FRAMES} frames or more",
                fix="Leave it out for 40.",
            )

    def needed(self, frames: int) -> tuple[int, ...]:
        """Positions of the frames that are used of so many."""
        if frames <= self.most:
            return tuple(range(frames))
        return tuple(int(position) for position in np.linspace(0, frames - 1, self.most).round())


@dataclass(frozen=True, eq=False)
class RowPoints:
    """Points of one frame in both eyes.

    Args:
        u: (N,) column in the right picture, px.
        v: (N,) row in the left picture, px.
        lower_px: (N,) how much lower the right picture shows them.
        size_px: (width, height).
    """

    u: Float64
    v: Float64
    lower_px: Float64
    size_px: tuple[int, int]


def row_points(pair: MatchedPair) -> RowPoints:
    """Corners of the left picture found in the right one, wherever a disparity is near them."""
    height, width = pair.left.shape
    uv = spread_corners(pair.left, per_cell=CORNERS_PRECISE)
    everywhere = MatchedPair(pair.left, pair.right, filled(pair.disparity))
    matched = everywhere.disparity_at(uv)
    uv, matched = (column[np.isfinite(matched)] for column in (uv, matched))
    guess = np.column_stack([uv[:, 0] - matched, uv[:, 1]]).astype(np.float32)
    there, found = follow_both_ways(
        pair.left,
        pair.right,
        uv,
        guess,
        window_px=WINDOW_ACROSS_PX,
        levels=1,
        within_px=RETURNS_PX,
    )
    off = np.abs(there - guess)
    found &= (off[:, 0] < MOST_FROM_MATCHED_PX) & (off[:, 1] < MOST_ROWS_PX)
    in_right, in_left = (np.asarray(column[found], np.float64) for column in (there, uv))
    u, v = in_right[:, 0], in_left[:, 1]
    return RowPoints(u, v, in_right[:, 1] - v, (width, height))


@dataclass(frozen=True, eq=False)
class RowFit:
    """Row differences of a rig before and after what can be put right.

    Args:
        correction: for the rig; None where there is nothing to be gained, or too little was seen.
        reason: why there is none, else empty.
        points: how many were compared.
        frames: of how many frames.
        before_px: row difference of 68 % of the points.
        after_px: the same on frames that were left out of the fit.
    """

    correction: RowCorrection | None
    reason: str
    points: int
    frames: int
    before_px: float | None
    after_px: float | None

    @property
    def line(self) -> str:
        """For people."""
        if self.before_px is None or self.after_px is None:
            return f"rows: not corrected, {self.reason}"
        seen = (
            f"68 % within {self.before_px:.2f} px of each other, {self.after_px:.2f} px corrected"
        )
        seen += f" ({self.points} points of {self.frames} frames, judged on frames left out)"
        return f"rows: {seen}" if self.correction else f"rows: {seen}; {self.reason}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "corrected": self.correction is not None,
            "reason": self.reason,
            "points": self.points,
            "frames": self.frames,
            "before_px": self.before_px,
            "after_px": self.after_px,
        }


def fit_rows(frames: Sequence[RowPoints], *, origin: str = "") -> RowFit:
    """Fit a smooth row correction, robust to wrong points, and judge it on frames left out.

    Args:
        frames: points of each frame; all are of the size of the first.
        origin: what they are, in words; kept with the correction.
    """
    frames = [points for points in frames if len(points.u)]
    total = sum(len(points.u) for points in frames)
    if len(frames) < MIN_FRAMES or total < MIN_POINTS:
        reason = f"{total} points of {len(frames)} frames are too few"
        return RowFit(None, reason, total, len(frames), None, None)
    size_px = frames[0].size_px
    features = np.concatenate(
        [RowCorrection.features(points.u, points.v, points.size_px) for points in frames]
    )
    lower_px = np.concatenate([points.lower_px for points in frames])
    frame = np.repeat(np.arange(len(frames)), [len(points.u) for points in frames])
    covered = _covered(frames)
    if covered < LEAST_COVERED:
        reason = f"the points cover only {covered:.0%} of the picture"
        return RowFit(None, reason, total, len(frames), None, None)
    before_px = one_sigma(lower_px)
    after_px = one_sigma(_left_out_residuals(features, lower_px, frame))
    described = origin or f"{total} points of {len(frames)} frames"
    if after_px > (1 - LEAST_GAIN) * before_px:
        reason = "nothing to be gained, not corrected"
        return RowFit(None, reason, total, len(frames), before_px, after_px)
    independent = len(frames) * INDEPENDENT_PER_FRAME
    coefficients = fitted_rows(features, lower_px, independent=independent)
    described = f"{described}: rows {before_px:.2f} to {after_px:.2f} px, {size_px[0]}x{size_px[1]}"
    correction = RowCorrection(coefficients, after_px, described)
    return RowFit(correction, "", total, len(frames), before_px, after_px)


def _left_out_residuals(features: Float64, lower_px: Float64, frame: Int64) -> Float64:
    """(N,) row differences left by a fit to other frames."""
    left = np.empty_like(lower_px)
    turns = frame % min(FOLDS, int(frame.max()) + 1)
    for turn in np.unique(turns):
        held: Bool = turns == turn
        fitted = len(np.unique(frame[~held]))
        coefficients = fitted_rows(
            features[~held], lower_px[~held], independent=fitted * INDEPENDENT_PER_FRAME
        )
        left[held] = lower_px[held] - row_offsets(features[held], coefficients)
    return left


def _covered(frames: Sequence[RowPoints]) -> float:
    """Share of the blocks of the image that hold points enough."""
    counts = np.zeros(BLOCKS)
    for points in frames:
        spans = ((0, points.size_px[0]), (0, points.size_px[1]))
        counts += np.histogram2d(points.u, points.v, bins=BLOCKS, range=spans)[0]
    return float(np.mean(counts >= LEAST_IN_BLOCK))
