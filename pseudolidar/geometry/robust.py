"""The spread of values of which some are wrong."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import AnyArray

# Standard deviation of a normal distribution by its median absolute deviation: 1 / 0.6745. Source:
# Huber & Ronchetti, Robust Statistics, 2nd ed., section 5.1.
SIGMA_PER_MAD = 1.4826


def robust_sigma(residuals: AnyArray) -> float:
    """One standard deviation of residuals about 0 that a third of wrong ones hardly change.

    Args:
        residuals: of any shape, at least one.
    """
    return SIGMA_PER_MAD * float(np.median(np.abs(residuals)))
