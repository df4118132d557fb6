"""What every stereo matcher is: a rectified pair in, a disparity map out."""

from __future__ import annotations

from typing import Protocol

from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M, DisparityMap
from pseudolidar.structures.frame import StereoFrame


class StereoMatcher(Protocol):
    """A loaded matcher; safe to call from several threads at once."""

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image of `frame`, with sigma where the matcher estimates it."""


class MatcherSettings(Protocol):
    """Settings of a matcher."""

    @property
    def compares_brightness(self) -> bool:
        """Whether its cost is worse where the eyes are exposed differently."""

    def load(self, *, min_depth_m: float = DEFAULT_MIN_DEPTH_M) -> StereoMatcher:
        """The matcher, with everything heavy loaded, that searches down to a depth (m)."""
