"""Depth errors of a set of points: every figure once, with its interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from pseudolidar.evaluation.comparison.bins import DepthBins, in_bin
from pseudolidar.evaluation.comparison.bootstrap import FrameBootstrap, Interval, interval
from pseudolidar.evaluation.comparison.points import ComparedPoints
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.disparity import RADIUS_95_PER_SIGMA

# An inlier's depth and its reference differ by less than this factor.
# Source of the second: Eigen et al., Depth Map Prediction from a Single Image, NeurIPS 2014.
INLIER_FACTORS = {"delta_1_05": 1.05, "delta_1_25": 1.25}
# Radii that a stated sigma gives a share of the errors for.
SIGMA_RADII = {"within_1_sigma": 1.0, "within_95": RADIUS_95_PER_SIGMA}


@dataclass(frozen=True)
class DepthFigures:
    """Errors of stereo depths, relative to the reference; None where there is no point.

    Args:
        reference: reference points in view.
        n: those that stereo has a point for.
        density: their share.
        median_rel: median absolute relative error.
        p90_rel: 90th percentile of it.
        bias_rel: signed median; > 0 where stereo is too far.
        abs_rel: mean absolute relative error.
        rmse_m: root mean square error, m.
        rmse_log: root mean square error of the natural logarithm of depth.
        delta_1_05: share of points whose depth is off by less than the factor 1.05.
        delta_1_25: ... 1.25.
        within_1_sigma: share of disparities within one sigma; 0.68 is right. None without sigma.
        within_95: share within the 95 % radius.
        intervals: 95 % intervals over frames by the name of the figure; empty for fewer than two
            frames.
    """

    reference: int
    n: int
    density: float | None = None
    median_rel: float | None = None
    p90_rel: float | None = None
    bias_rel: float | None = None
    abs_rel: float | None = None
    rmse_m: float | None = None
    rmse_log: float | None = None
    delta_1_05: float | None = None
    delta_1_25: float | None = None
    within_1_sigma: float | None = None
    within_95: float | None = None
    intervals: Mapping[str, Interval] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The fields; intervals as lists of two."""
        intervals = {name: list(bounds) for name, bounds in self.intervals.items()}
        return {**vars(self), "intervals": intervals}


# Names of the figures, in the order of tables.
FIGURES = tuple(
    name
    for name in DepthFigures.__dataclass_fields__
    if name not in ("reference", "n", "intervals")
)


@dataclass(frozen=True)
class RangeFigures:
    """Figures of one bin of the reference's depth.

    Args:
        from_m: nearest depth of the bin, inclusive.
        to_m: farthest, exclusive.
        figures: of its points.
    """

    from_m: int
    to_m: int
    figures: DepthFigures

    def as_dict(self) -> dict[str, Any]:
        """The bin and its figures side by side."""
        return {"from_m": self.from_m, "to_m": self.to_m, **self.figures.as_dict()}


def figures_by_range(
    points: ComparedPoints, bins: DepthBins, bootstrap: FrameBootstrap | None = None
) -> tuple[RangeFigures, ...]:
    """Figures of every bin, pooled over the points of all frames.

    Args:
        points: to be judged.
        bins: of the reference's depth.
        bootstrap: resamples of their frames, for intervals.
    """
    return tuple(
        RangeFigures(*bin_m, depth_figures(points[in_bin(points.reference_m, bin_m)], bootstrap))
        for bin_m in bins
    )


def depth_figures(points: ComparedPoints, bootstrap: FrameBootstrap | None = None) -> DepthFigures:
    """Figures of all points together.

    Args:
        points: to be judged.
        bootstrap: resamples of their frames, for intervals.
    """
    matched = points[points.matched]
    pooled = _estimates(matched, Pooled(len(matched), len(points)))
    known = {name: float(value) for name, value in pooled.items() if np.isfinite(value)}
    intervals: dict[str, Interval] = {}
    if bootstrap is not None and bootstrap.frames > 1:
        resampled = _estimates(matched, Resampled(bootstrap, matched.frame, points.frame))
        bounds = {name: interval(estimates) for name, estimates in resampled.items()}
        intervals = {name: found for name, found in bounds.items() if found is not None}
    return DepthFigures(len(points), len(matched), **known, intervals=intervals)


class Statistics(Protocol):
    """How figures are taken of matched points: of all once, or of each resample of frames."""

    def mean(self, values: Float64) -> Float64:
        """Mean of values (N,) of the points; NaN without any."""

    def quantiles(self, values: Float64, *shares: float) -> Float64:
        """Quantiles of values (N,) of the points, one row a share; NaN without any."""

    def density(self) -> Float64:
        """Share of the reference points that are matched."""


@dataclass(frozen=True)
class Pooled:
    """Of all points once.

    Args:
        matched: number of points.
        reference: number of reference points.
    """

    matched: int
    reference: int

    def mean(self, values: Float64) -> Float64:
        """One number."""
        return np.asarray(values.mean() if len(values) else np.nan)

    def quantiles(self, values: Float64, *shares: float) -> Float64:
        """(len(shares),)."""
        return np.asarray(
            np.quantile(values, shares) if len(values) else np.full(len(shares), np.nan)
        )

    def density(self) -> Float64:
        """One number."""
        return np.asarray(self.matched / self.reference if self.reference else np.nan)


class Resampled:
    """Of each resample of the frames.

    Args:
        bootstrap: the resamples.
        matched: (N,) frames of the points.
        reference: (M,) frames of all reference points.
    """

    def __init__(self, bootstrap: FrameBootstrap, matched: Int64, reference: Int64) -> None:
        self._bootstrap, self._frame = bootstrap, matched
        self._n = bootstrap.sums(np.ones(len(matched)), matched)
        self._reference = bootstrap.sums(np.ones(len(reference)), reference)

    def mean(self, values: Float64) -> Float64:
        """(resamples,)."""
        return _ratio(self._bootstrap.sums(values, self._frame), self._n)

    def quantiles(self, values: Float64, *shares: float) -> Float64:
        """(len(shares), resamples)."""
        return self._bootstrap.quantiles(values, self._frame, shares)

    def density(self) -> Float64:
        """(resamples,)."""
        return _ratio(self._n, self._reference)


def _ratio(part: Float64, whole: Float64) -> Float64:
    unknown = np.full(len(whole), np.nan)
    return np.asarray(np.divide(part, whole, out=unknown, where=whole > 0))


def _estimates(points: ComparedPoints, statistics: Statistics) -> dict[str, Float64]:
    """Every figure of matched points."""
    ratio = points.depth_m / points.reference_m
    factor = np.maximum(ratio, 1.0 / ratio)
    off_m = points.depth_m - points.reference_m
    median, p90 = statistics.quantiles(np.abs(ratio - 1.0), 0.5, 0.9)
    found = {
        "density": statistics.density(),
        "median_rel": median,
        "p90_rel": p90,
        "bias_rel": statistics.quantiles(ratio - 1.0, 0.5)[0],
        "abs_rel": statistics.mean(np.abs(ratio - 1.0)),
        "rmse_m": np.sqrt(statistics.mean(off_m**2)),
        "rmse_log": np.sqrt(statistics.mean(np.log(ratio) ** 2)),
    }
    for name, limit in INLIER_FACTORS.items():
        found[name] = statistics.mean((factor < limit).astype(np.float64))
    if points.sigma_px is not None:
        sigmas = np.abs(points.error_px) / points.sigma_px
        for name, radius in SIGMA_RADII.items():
            found[name] = statistics.mean((sigmas <= radius).astype(np.float64))
    return found
