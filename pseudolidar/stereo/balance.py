"""`--balance`: the right eye's picture as the left eye would have taken it, for costs that care."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from pseudolidar.geometry.photometric import (
    PhotometricDifference,
    fit_difference,
    radius2_of,
)
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.matcher import MatcherSettings, StereoMatcher
from pseudolidar.structures.arrays import Float64, Image
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M, DisparityMap
from pseudolidar.structures.frame import StereoFrame

if TYPE_CHECKING:
    from pseudolidar.stereo.census import CensusMatcher

BalanceWhen = Literal["auto", "always", "never"]
# Matches for the fit are looked for in pictures of about this width: it takes a tenth of the time
# of matching the whole ones, and each of their pixels is a mean of many.
SMALL_WIDTH_PX, NARROWEST_PX, SHORTEST_PX = 320, 64, 16
# Differences below this (share of the range, at usual brightnesses) are left as they are by `auto`.
LEAST_DIFFERENCE = 0.02
# Share of the pixels that one eye is too bright for and the other not, from which on that counts:
# there one picture has a texture that the other has not, which misleads every cost. On KITTI stereo
# 2015, differently exposed, to show both clipped alike helps census from about here on; at 0.02 to
# 0.04 it costs it up to 1.5 points of D1 with gaps filled, 2026-11-26.
CLIPPED_SHARE = 0.05
# Every so many pixels are looked at for it.
CLIPPED_STEP = 3


def balanced(
    settings: MatcherSettings,
    when: BalanceWhen,
    *,
    min_depth_m: float = DEFAULT_MIN_DEPTH_M,
) -> StereoMatcher:
    """The loaded matcher, behind a balance of the eyes.

    Args:
        settings: of the matcher.
        when: `auto` where pairs differ by more than the matcher's cost can stand; `always` for
            every pair and any matcher; `never`.
        min_depth_m: nearest depth that must be found, m.
    """
    matcher = settings.load(min_depth_m=min_depth_m)
    if when == "never":
        return matcher
    cares = settings.compares_brightness or when == "always"
    least = (LEAST_DIFFERENCE if when == "auto" else 0.0) if cares else None
    return BalancedMatcher(matcher, Census().load(min_depth_m=min_depth_m), least)


@dataclass(frozen=True)
class BalancedMatcher:
    """A matcher that sees the right picture as the left eye would have taken it.

    Where one eye is clipped and the other not, both are shown clipped.

    Args:
        matcher: what finds the disparities.
        scout: matches small pictures, by a cost that does not care for brightness.
        least: differences below it are left as they are, share of the range; None to leave all,
            for a cost that does not care.
    """

    matcher: StereoMatcher
    scout: CensusMatcher
    least: float | None

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image; raises as the matcher does."""
        return self.matcher(self.balanced(frame))

    def balanced(self, frame: StereoFrame) -> StereoFrame:
        """The pair with its eyes equalised; itself where there is nothing to be done."""
        clipped = abs(clipped_share(frame.left) - clipped_share(frame.right)) > CLIPPED_SHARE
        if self.least is None and not clipped:
            return frame
        difference = measured(frame, self.scout)
        if difference is None:
            return frame
        left, right = frame.left, frame.right
        if clipped:
            left, right = difference.clipped_alike(left, right)
        if self.least is not None and difference.largest >= self.least:
            right = difference.undone(right)
        elif not clipped:
            return frame
        return replace(frame, left=left, right=right)


def clipped_share(image: Image) -> float:
    """Share of the pixels at the end of their range in every channel: these have no texture.

    Where one channel is clipped, the others show the same to both eyes. A channel's end is the
    largest value that it has: white that is clipped, then balanced, is no white any more.
    """
    some = np.atleast_3d(image[::CLIPPED_STEP, ::CLIPPED_STEP])
    ends = some.max(axis=(0, 1))
    if ends.max() < np.iinfo(image.dtype).max:
        return 0.0
    return float((some == ends).all(axis=2).mean())


def measured(frame: StereoFrame, scout: StereoMatcher) -> PhotometricDifference | None:
    """How the eyes of a pair differ, at the pixels that the scout matches in small pictures.

    None where the pair is too narrow to be matched, or too little of it is.
    """
    width, height = frame.size_px
    shrink = max(1, round(width / SMALL_WIDTH_PX))
    small = (width // shrink, height // shrink)
    if small[0] < NARROWEST_PX or small[1] < SHORTEST_PX:
        return None
    left, right = (_resized(eye, small) for eye in (frame.left, frame.right))
    rig = frame.rig.scaled_to(*small)
    pair = StereoFrame(left, right, rig, frame.id, frame.index, frame.timestamp_ns)
    found = scout(pair).values
    rows, columns = np.nonzero(np.isfinite(found))
    targets = np.rint(columns - found[rows, columns]).astype(np.int64)
    inside = targets >= 0
    rows, columns, targets = rows[inside], columns[inside], targets[inside]
    return fit_difference(
        _shares(left)[rows, columns],
        _shares(right)[rows, targets],
        radius2_of(found.shape)[rows, targets].astype(np.float64),
    )


def _resized(image: Image, size: tuple[int, int]) -> Image:
    import cv2

    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8) if image.dtype == np.uint8 else np.asarray(small, np.uint16)


def _shares(image: Image) -> Float64:
    """(H, W, C) shares of the range, of a neighbourhood of 3 x 3."""
    import cv2

    smooth = np.asarray(cv2.blur(image, (3, 3)), np.float64) / np.iinfo(image.dtype).max
    return np.atleast_3d(smooth)
