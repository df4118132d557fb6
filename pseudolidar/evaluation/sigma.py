"""How well stated uncertainties fit the errors that occur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pseudolidar.evaluation.ranges import RANGE_BINS_M
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE, RADIUS_95_PER_SIGMA

# Steps of the sparsification curve.
SPARSIFICATION_STEPS = 20


@dataclass(frozen=True)
class SigmaShares:
    """Shares of errors within the stated radii; None where there is no sample.

    Args:
        n: samples.
        within_1_sigma: share of errors within one sigma; 0.68 is right.
        within_95: share within the 95 % radius of 2.8 sigma; 0.95 is right.
    """

    n: int
    within_1_sigma: float | None
    within_95: float | None

    def as_dict(self) -> dict[str, Any]:
        """The fields."""
        return asdict(self)


def sigma_shares(error_px: Float64, sigma_px: Float64) -> SigmaShares:
    """Count errors within sigma and within the 95 % radius.

    Args:
        error_px: (N,) signed or absolute errors.
        sigma_px: (N,) one standard deviation each.
    """
    if not len(error_px):
        return SigmaShares(0, None, None)
    ratio = np.abs(error_px) / sigma_px
    within, within_95 = (float((ratio <= radius).mean()) for radius in (1.0, RADIUS_95_PER_SIGMA))
    return SigmaShares(len(ratio), within, within_95)


def sigma_shares_by_range(
    error_px: Float64, sigma_px: Float64, depth_m: Float64
) -> Sequence[dict[str, Any]]:
    """`sigma_shares` in every bin of the true depth (N,) m, with `from_m` and `to_m`."""
    rows = []
    for low, high in RANGE_BINS_M:
        inside = (depth_m >= low) & (depth_m < high)
        shares = sigma_shares(error_px[inside], sigma_px[inside])
        rows.append({"from_m": low, "to_m": high, **shares.as_dict()})
    return rows


def total_sigma(
    sigma_px: Float64, systematic_px: float, *, scale: float | Float64 = 1.0
) -> Float64:
    """(N,) sigma of the disparity: matching error, scaled, and the rig's systematic error."""
    return np.hypot(scale * sigma_px, systematic_px)


def fit_scale(error_px: Float64, sigma_px: Float64, systematic_px: float) -> float:
    """Factor on the matcher's sigma so that 68.27 % of the errors lie within the total sigma.

    |e|^2 <= (k sigma)^2 + systematic^2 holds for k >= sqrt(|e|^2 - systematic^2) / sigma.

    Args:
        error_px: (N,) errors, at least one, of corrected disparities.
        sigma_px: (N,) the matcher's sigma.
        systematic_px: one standard deviation of the rig's error.
    """
    beyond = np.sqrt(np.maximum(error_px**2 - systematic_px**2, 0.0))
    return float(np.quantile(beyond / sigma_px, ONE_SIGMA_SHARE))


@dataclass(frozen=True, eq=False)
class SparsificationCurve:
    """Mean absolute error of the surest samples, relative to that of all.

    Args:
        kept: (STEPS,) share of the samples that is kept, from 1 down.
        by_sigma: (STEPS,) relative error when the samples of the largest sigma go first.
        by_error: (STEPS,) ... when those of the largest error go first: no sigma can do better.
    """

    kept: Float64
    by_sigma: Float64
    by_error: Float64

    @property
    def area(self) -> float:
        """AUSE, the mean difference: 0 is perfect; an uninformative sigma has about 0.7."""
        return float((self.by_sigma - self.by_error).mean())

    def as_dict(self) -> dict[str, Any]:
        """The curves as lists, and the area between them."""
        return {**{name: curve.tolist() for name, curve in vars(self).items()}, "ause": self.area}


def sparsification_curve(error_px: Float64, sigma_px: Float64) -> SparsificationCurve | None:
    """The surest 100 %, 95 %, ... 5 % of the samples, by sigma and by the true error.

    Args:
        error_px: (N,) signed or absolute errors.
        sigma_px: (N,) one standard deviation each.

    Returns:
        None without samples, or without an error.

    Source: Ilg et al., Uncertainty Estimates and Multi-Hypotheses Networks for Optical Flow, ECCV
        2018, section 4.
    """
    size = np.abs(error_px)
    if not len(size) or size.mean() == 0:
        return None
    share = 1.0 - np.arange(SPARSIFICATION_STEPS) / SPARSIFICATION_STEPS
    kept = np.maximum(1, (len(size) * share).astype(np.intp))
    by_sigma, by_error = (
        np.cumsum(ordered)[kept - 1] / kept / size.mean()
        for ordered in (size[np.argsort(sigma_px, kind="stable")], np.sort(size))
    )
    return SparsificationCurve(share, by_sigma, by_error)


def sparsification_error(error_px: Float64, sigma_px: Float64) -> float | None:
    """Area between the sparsification curves of sigma and of the error itself (AUSE).

    Args:
        error_px: (N,) signed or absolute errors.
        sigma_px: (N,) one standard deviation each.
    """
    curve = sparsification_curve(error_px, sigma_px)
    return None if curve is None else curve.area
