"""`--rows`: each pair's right picture with its rows at the height of the left one's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pseudolidar.geometry.corners import spread_corners
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.geometry.lucas_kanade import follow, follow_both_ways
from pseudolidar.geometry.row_fit import LEAST_GAIN, fitted_rows, one_sigma, row_offsets
from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.arrays import Bool, Float32, Float64, UInt8
from pseudolidar.structures.correction import RowCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

RowsWhen = Literal["auto", "never"]
# Where a point is in the other eye is first looked for in pictures of about this width, from no
# guess at all, then made precise in the whole ones.
SMALL_WIDTH_PX, SMALL_LEVELS = 640, 3
SMALL_WINDOW_PX, WINDOW_PX = 9, 15
# Corners in each cell of the picture.
PER_CELL = 4
# A point comes back to this, and lies within so many rows, px; farther off than this in front of
# infinity there is nothing.
RETURNS_PX, MOST_ROWS_PX, BEYOND_PX = 0.25, 4.0, 1.0
# Fewer points tell nothing, and neighbours share their picture's errors: so many points are worth
# one.
MIN_POINTS, POINTS_PER_INDEPENDENT = 60, 4
# A field that is smaller than this everywhere is not worth resampling a picture for, px.
LEAST_PX = 0.1


@dataclass(frozen=True)
class RowAligned:
    """A matcher that sees the right picture with its rows where the left one has them.

    Args:
        matcher: what finds the disparities.
    """

    matcher: StereoMatcher

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image; raises as the matcher does."""
        return self.matcher(aligned(frame))


def aligned(frame: StereoFrame) -> StereoFrame:
    """The pair with its rows aligned; itself where nothing is to be gained."""
    rows = rows_between(*grey8_pair(frame.left, frame.right))
    return frame if rows is None else replace(frame, right=rows_aligned(frame.right, rows))


def rows_between(left: UInt8, right: UInt8) -> RowCorrection | None:
    """The smooth difference of rows between the eyes of one pair.

    None where too few points are seen in both, where points left out of the fit gain nothing, or
    where there is next to none.

    Args:
        left: (H, W) grey.
        right: (H, W) grey.
    """
    uv, there = _seen_by_both(left, right)
    if len(uv) < MIN_POINTS:
        return None
    height, width = left.shape
    lower_px = there[:, 1] - uv[:, 1]
    features = RowCorrection.features(there[:, 0], uv[:, 1], (width, height))
    coefficients = fitted_rows(features, lower_px, independent=len(uv) / POINTS_PER_INDEPENDENT)
    before_px = one_sigma(lower_px)
    after_px = one_sigma(_left_out(features, lower_px, coefficients))
    if after_px > (1 - LEAST_GAIN) * before_px:
        return None
    rows = RowCorrection(coefficients, after_px)
    return rows if np.abs(rows.field_px(width, height)).max() > LEAST_PX else None


def _seen_by_both(left: UInt8, right: UInt8) -> tuple[Float64, Float64]:
    """(N, 2) corners of the left picture, and (N, 2) where the right one shows them, px."""
    shrink = max(1, round(left.shape[1] / SMALL_WIDTH_PX))
    small_left, small_right = (_smaller(eye, shrink) for eye in (left, right))
    corners = spread_corners(small_left, per_cell=PER_CELL)
    guess, found = follow(
        small_left,
        small_right,
        corners,
        corners,
        window_px=SMALL_WINDOW_PX,
        levels=SMALL_LEVELS,
    )
    found &= _plausible(corners, guess, shrink)
    uv, guess = (_larger(points[found], shrink) for points in (corners, guess))
    there, found = follow_both_ways(
        left, right, uv, guess, window_px=WINDOW_PX, within_px=RETURNS_PX
    )
    found &= _plausible(uv, there, 1)
    return uv[found].astype(np.float64), there[found].astype(np.float64)


def _plausible(uv: Float32, there: Float32, shrink: int) -> Bool:
    off = (there - uv) * shrink
    return np.asarray((np.abs(off[:, 1]) < MOST_ROWS_PX) & (off[:, 0] < BEYOND_PX))


def _left_out(features: Float64, lower_px: Float64, start: Float64) -> Float64:
    """(N,) row differences left by a fit to every other point, begun at `start` (9,)."""
    left = np.empty_like(lower_px)
    worth = len(lower_px) / (2 * POINTS_PER_INDEPENDENT)
    for turn in (0, 1):
        held, others = slice(turn, None, 2), slice(1 - turn, None, 2)
        coefficients = fitted_rows(
            features[others], lower_px[others], independent=worth, start=start
        )
        left[held] = lower_px[held] - row_offsets(features[held], coefficients)
    return left


def _smaller(eye: UInt8, shrink: int) -> UInt8:
    import cv2

    if shrink == 1:
        return eye
    size = eye.shape[1] // shrink, eye.shape[0] // shrink
    cut = eye[: size[1] * shrink, : size[0] * shrink]
    return np.asarray(cv2.resize(cut, size, interpolation=cv2.INTER_AREA), np.uint8)


def _larger(points: Float32, shrink: int) -> Float32:
    """Pixel coordinates of the small picture in the whole one."""
    return np.asarray(points * shrink + (shrink - 1) / 2, np.float32)
