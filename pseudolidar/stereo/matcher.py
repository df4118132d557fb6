"""What every stereo matcher is: a rectified pair in, a disparity map out."""

from __future__ import annotations

from typing import Protocol

from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

DEFAULT_MIN_DEPTH_M = 3.0


class StereoMatcher(Protocol):
    """A loaded matcher; safe to call from several threads at once."""

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image of `frame`, with sigma where the matcher estimates it."""
