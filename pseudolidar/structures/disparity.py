"""Disparity and depth maps with their uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Bool, Float32, check_array

# Nearest depth that is looked for where neither user nor data say one, m.
DEFAULT_MIN_DEPTH_M = 3.0
# Share of errors that one sigma holds: that of a normal distribution.
ONE_SIGMA_SHARE = 0.6827
# Ratio of the 95 % radius to sigma (68 %). Errors have heavy tails: a Gaussian would have 1.96.
# Measured on KITTI stereo 2015, 2026-11-23.
RADIUS_95_PER_SIGMA = 2.8

# Digits of depths that a person would type: 0.25 m, 3 m, 12 m.
TYPED = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)


def typed_below(depth_m: float) -> float:
    """The largest number that a person would type for a depth and that is not above it, m."""
    power = math.floor(math.log10(depth_m))
    digits = depth_m / 10.0**power
    # Digits of 2.9999999999999996 are those of 3.
    at_most = max(d for d in TYPED if d <= digits * (1 + 1e-9))
    return float(f"{at_most:g}e{power}")


@dataclass(frozen=True, eq=False)
class DisparityMap:
    """Disparity of each pixel of the left image.

    Args:
        values: (H, W) float32 px, > 0, NaN where there is none.
        sigma: (H, W) float32 px, one standard deviation (68 %) of the matching error, NaN where
            values are;
            None where nobody estimated it (ground truth).
    """

    values: Float32
    sigma: Float32 | None = None

    def __post_init__(self) -> None:
        check_array("DisparityMap", "values", self.values, (None, None), np.float32)
        if self.sigma is not None:
            check_array("DisparityMap", "sigma", self.sigma, self.values.shape, np.float32)

    @property
    def valid(self) -> Bool:
        """(H, W) pixels that have a disparity."""
        return np.isfinite(self.values)

    @property
    def density(self) -> float:
        """Share of pixels that have a disparity, 0-1."""
        return float(self.valid.mean())


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth Z along the optical axis of each pixel of the left image.

    Args:
        values: (H, W) float32 m, NaN where there is none.
        sigma: (H, W) float32 m, one standard deviation, or None.
    """

    values: Float32
    sigma: Float32 | None = None

    def __post_init__(self) -> None:
        check_array("DepthMap", "values", self.values, (None, None), np.float32)
        if self.sigma is not None:
            check_array("DepthMap", "sigma", self.sigma, self.values.shape, np.float32)

    @property
    def valid(self) -> Bool:
        """(H, W) pixels that have a depth."""
        return np.isfinite(self.values)
