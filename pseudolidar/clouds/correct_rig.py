"""The part of a cloud's error that is the rig's: smooth over the image and the disparities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

# Errors of neighbouring points are correlated: those of one scan tell as much as so many
# independent ones. Measured on KITTI stereo 2015 with 4 level beams, which leave the ground near
# the car unknown: error at 5-10 m 0.97, 0.82, 1.05, 1.38 % with 10, 30, 100, 300; beyond 30 m
# no difference.
INDEPENDENT = 30
# Coefficients are expected within so many times the error that the rig is known to have, px.
PRIOR_PER_SYSTEMATIC, LEAST_PRIOR_PX = 2.0, 0.05
# Width of the Cauchy distribution that weighs residuals, per 68 % of them.
CAUCHY_PER_SIGMA = 0.55
LEAST_SCALE = 1e-3
ITERATIONS, CONVERGED_PX = 20, 1e-3


@dataclass(frozen=True, eq=False)
class RigError:
    """`error = features . coefficients`, with what is not known of them.

    Args:
        coefficients: (8,) px, of the features of `DisparityCorrection`.
        covariance: (8, 8) px^2.
    """

    coefficients: Float64
    covariance: Float64

    def at(self, features: Float64) -> tuple[Float64, Float64]:
        """(N,) px and (N,) its standard deviation, px, of (N, 8) features."""
        variance = (_times(features, self.covariance) * features).sum(axis=1)
        return _times(features, self.coefficients), np.sqrt(np.maximum(variance, 0.0))


def rig_error(
    features: Float64, error_px: Float64, sigma_px: Float64, *, systematic_px: float
) -> RigError:
    """Most likely coefficients where errors are Cauchy-distributed, wide as sigma says.

    A normal prior keeps what the samples do not determine near zero, as of beams that see only the
    far part of a scene.

    Args:
        features: (M, 8) of `DisparityCorrection`.
        error_px: (M,) to explain, px.
        sigma_px: (M,) one standard deviation of each.
        systematic_px: error that the rig is known to have.
    """
    count = features.shape[1]
    precision = 1.0 / sigma_px**2
    prior_px = max(LEAST_PRIOR_PX, PRIOR_PER_SYSTEMATIC * systematic_px)
    coefficients = np.zeros(count)
    coefficients[0] = np.median(error_px)
    for _ in range(ITERATIONS):
        ratio = np.abs(error_px - _times(features, coefficients)) / sigma_px
        scale = max(LEAST_SCALE, float(np.quantile(ratio, ONE_SIGMA_SHARE)))
        weight = precision / (1.0 + (ratio / (CAUCHY_PER_SIGMA * scale)) ** 2)
        weighted = features * (weight / weight.sum())[:, None]
        variance = scale**2 / (precision.mean() * INDEPENDENT)
        normal = np.einsum("ni,nj->ij", weighted, features)
        normal += variance / prior_px**2 * np.eye(count)
        updated = np.linalg.solve(normal, np.einsum("ni,n->i", weighted, error_px))
        change = np.abs(updated - coefficients).max()
        coefficients = updated
        if change < CONVERGED_PX:
            break
    return RigError(coefficients, variance * np.linalg.inv(normal))


def _times(rows: Float64, factor: Float64) -> Float64:
    """`rows @ factor`, with the same roundings for any number of threads, which BLAS has not."""
    return np.asarray(np.einsum("ni,i...->n...", rows, factor))
