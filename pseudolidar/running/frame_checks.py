"""Pairs that must not become clouds, although each of their images is fine."""

from __future__ import annotations

import numpy as np

from pseudolidar.errors import LowTexture, PairIdentical
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Share of pixels with a disparity below which there is nothing to see. Black, white and evenly
# coloured pairs give 0, the poorest KITTI frame more than 0.5.
MIN_DENSITY = 0.02


def check_pair(frame: StereoFrame) -> None:
    """Refuse a pair whose images are the same.

    Raises:
        PairIdentical: they are, to the last bit.
    """
    if np.array_equal(frame.left, frame.right):
        raise PairIdentical(
            "left and right are the same image",
            want="two views of the scene",
            fix="Check that both folders are not the same.",
            where=f"frame {frame.id}",
        )


def check_texture(frame: StereoFrame, disparity: DisparityMap) -> None:
    """Refuse a disparity map with almost nothing in it: black, white, fog, a wall.

    Raises:
        LowTexture: less than 2 % of the pixels have a disparity.
    """
    density = disparity.density
    if density < MIN_DENSITY:
        raise LowTexture(
            f"{density:.2%} of the pixels could be matched",
            want=f"at least {MIN_DENSITY:.0%}",
            fix="The pair is black, overexposed or without texture; leave it out with --exclude.",
            where=f"frame {frame.id}",
        )
