"""Weights for corners and views that disagree with the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Bool, Float64

# Lengths of errors of two equal Gaussian coordinates have their median at 1.18 of a coordinate's
# standard deviation.
MEDIAN_OF_LENGTHS = 1.1774
# A corner counts half at this many standard deviations (95 % efficiency on Gaussian errors is at
# 2.4).
CORNER_SIGMAS = 3.0
# Corners are never found better than this, px: what is below is no reason to doubt a corner.
LEAST_SIGMA_PX = 0.03


@dataclass(frozen=True)
class Cauchy:
    """Cauchy's weights, at a scale that the residuals themselves give.

    Args:
        corner_sigmas: standard deviations at which a corner counts half.
        view_ratio: a view counts half where its eyes' corners are off by this many times what is
            usual; None for views that all count alike.
    """

    corner_sigmas: float = CORNER_SIGMAS
    view_ratio: float | None = None

    def __call__(self, residuals: Float64, seen: Bool) -> Float64:
        """Weights (V, E, N) of residuals (V, E, N, 2)."""
        lengths = np.linalg.norm(residuals, axis=-1)
        sigma = spread(residuals, seen)
        weights = np.where(seen, 1.0 / (1.0 + (lengths / (self.corner_sigmas * sigma)) ** 2), 0.0)
        if self.view_ratio is not None:
            off = view_spread(residuals, seen)
            usual = max(float(np.median(off)), LEAST_SIGMA_PX)
            weights *= (1.0 / (1.0 + (off / (self.view_ratio * usual)) ** 2))[:, None, None]
        return np.asarray(weights)


def spread(residuals: Float64, seen: Bool) -> float:
    """Standard deviation of a coordinate, px, told by the median and so not by outliers."""
    lengths = np.linalg.norm(residuals[seen], axis=-1)
    return max(float(np.median(lengths)) / MEDIAN_OF_LENGTHS, LEAST_SIGMA_PX)


def view_spread(residuals: Float64, seen: Bool) -> Float64:
    """(V,) the same of each view."""
    lengths = np.where(seen, np.linalg.norm(residuals, axis=-1), np.nan)
    with np.errstate(all="ignore"):
        medians = np.nanmedian(lengths.reshape(len(lengths), -1), axis=1)
    return np.asarray(medians / MEDIAN_OF_LENGTHS)


def rms(residuals: Float64, seen: Bool) -> float:
    """Root of the mean squared length, px: what OpenCV calls the reprojection error."""
    return float(np.sqrt((residuals[seen] ** 2).sum(axis=-1).mean())) if seen.any() else 0.0
