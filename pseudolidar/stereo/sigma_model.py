"""Sigma of a disparity from what its neighbourhood looks like: a log-linear model.

log2 sigma = constant + sum_j linear_j f_j + quadratic_j f_j^2, over the features

    support   share of valid pixels in the 7x7 window, 0-1
    same      share of those on the surface of the centre, 0-1
    size      log2 d
    spread    log2(0.02 + mean deviation of the valid pixels from the centre, px)
    distinct  log2 of (second best sum - best) / (best + 1), floored at 0.01

each clipped to the range that it was fitted on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Float32, Float64
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

FEATURES = ("support", "same", "size", "spread", "distinct")
# Degrees of freedom of the Student t that residuals are fitted with: errors have heavy tails.
STUDENT_FREEDOM = 3.0
# Fewer cannot tell eleven coefficients; and how much the squares of those count, in log-likelihood
# a sample: it only keeps them finite where a feature is constant.
MIN_SAMPLES, RIDGE = 1000, 1e-4


@dataclass(frozen=True)
class SigmaModel:
    """Coefficients of the model; all tuples have one entry a feature.

    Args:
        constant: log2 px.
        linear: of the features.
        quadratic: of their squares.
        low: smallest value that a feature is taken for.
        high: largest value that a feature is taken for.
    """

    constant: float
    linear: tuple[float, ...]
    quadratic: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]

    def as_array(self) -> Float32:
        """(5, 5) float32 for the kernel: rows low, high, linear, quadratic, constant."""
        constants = (self.constant,) + (0.0,) * (len(FEATURES) - 1)
        rows = (self.low, self.high, self.linear, self.quadratic, constants)
        return np.array(rows, np.float32)

    def sigma_px(self, features: Float64) -> Float64:
        """(N,) px from (N, 5) features."""
        f = np.clip(features, self.low, self.high)
        log_sigma = self.constant + f @ np.array(self.linear) + f * f @ np.array(self.quadratic)
        return np.asarray(np.exp2(log_sigma))


def fit_sigma(features: Float64, errors_px: Float64) -> SigmaModel:
    """Fit the model to disparity errors by Student-t likelihood, then scale it to 68.27 %.

    Args:
        features: (N, 5) of pixels with known truth.
        errors_px: (N,) disparity errors there, systematic part removed.

    Raises:
        StructureError: fewer than 1000 samples.
    """
    from scipy.optimize import minimize

    if len(errors_px) < MIN_SAMPLES:
        raise StructureError(
            f"{len(errors_px)} samples", want=f"at least {MIN_SAMPLES}", where="fit_sigma"
        )
    low, high = np.quantile(features, (0.001, 0.999), axis=0)
    f = np.clip(features, low, high)
    mean, scale = f.mean(axis=0), f.std(axis=0) + 1e-9
    z = (f - mean) / scale
    design = np.hstack([np.ones((len(z), 1)), z, z * z])
    absolute, nu, ridge = np.abs(errors_px), STUDENT_FREEDOM, RIDGE

    def loss(w: Float64) -> tuple[float, Float64]:
        log_sigma = design @ w
        ratio = (absolute * np.exp(-log_sigma)) ** 2 / nu
        value = log_sigma + (nu + 1) / 2 * np.log1p(ratio)
        slope = design.T @ (1 - (nu + 1) * ratio / (1 + ratio)) / len(absolute)
        penalty = np.concatenate([[0.0], w[1:]])
        return float(value.mean() + ridge * (penalty @ penalty)), slope + 2 * ridge * penalty

    w = minimize(loss, np.zeros(design.shape[1]), jac=True, method="L-BFGS-B").x
    w[0] += np.log(np.quantile(absolute / np.exp(design @ w), ONE_SIGMA_SHARE))
    return _unscaled(w / np.log(2), mean, scale, low, high)


def _unscaled(w: Float64, mean: Float64, scale: Float64, low: Float64, high: Float64) -> SigmaModel:
    n = len(FEATURES)
    slope, curve = w[1 : n + 1] / scale, w[n + 1 :] / scale**2
    constant = w[0] - slope @ mean + curve @ mean**2

    def rounded(values: Float64) -> tuple[float, ...]:
        return tuple(round(float(v), 5) for v in values)

    return SigmaModel(
        constant=round(float(constant), 5),
        linear=rounded(slope - 2 * curve * mean),
        quadratic=rounded(curve),
        low=rounded(low),
        high=rounded(high),
    )
