"""The smooth difference of rows that points of both eyes show, whatever some of them say."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

# How large coefficients are expected to be, one standard deviation, px.
PRIOR_PX = 1.0
MAX_ITERATIONS, CONVERGED_PX = 30, 1e-3
# Half width of the Cauchy distribution with 68 % of its mass within one sigma.
CAUCHY_PER_SIGMA = 0.55
# A correction that gains less than this on points left out, relatively, is none.
LEAST_GAIN = 0.1


def fitted_rows(
    features: Float64, lower_px: Float64, *, independent: float, start: Float64 | None = None
) -> Float64:
    """Most likely coefficients (K,) where errors are Cauchy-distributed.

    Args:
        features: (N, K) of `RowCorrection.features`.
        lower_px: (N,) how much lower the right picture shows the points.
        independent: how many independent points they are worth, against the prior.
        start: (K,) coefficients to begin with; None for the median alone.
    """
    if start is None:
        start = np.zeros(features.shape[1])
        start[0] = np.median(lower_px)
    coefficients = start
    for _ in range(MAX_ITERATIONS):
        error = lower_px - row_offsets(features, coefficients)
        scale = max(CONVERGED_PX, one_sigma(error))
        weight = 1.0 / (1.0 + (error / (CAUCHY_PER_SIGMA * scale)) ** 2)
        weighted = features * (weight / weight.sum())[:, None]
        prior = scale**2 / (independent * PRIOR_PX**2)
        # no BLAS: it rounds by its threads
        normal = np.einsum("ni,nj->ij", weighted, features) + prior * np.eye(len(coefficients))
        updated = np.linalg.solve(normal, np.einsum("ni,n->i", weighted, lower_px))
        change = np.abs(updated - coefficients).max()
        coefficients = updated
        if change < CONVERGED_PX:
            break
    return coefficients


def row_offsets(features: Float64, coefficients: Float64) -> Float64:
    """(N,) px that coefficients (K,) make of features (N, K)."""
    return np.asarray(np.einsum("nk,k->n", features, coefficients))


def one_sigma(errors: Float64) -> float:
    """What 68 % of them are within."""
    at = int(ONE_SIGMA_SHARE * (len(errors) - 1))
    return float(np.partition(np.abs(errors), at)[at])
