"""Clouds against clouds in figures: accuracy, completeness, chamfer distance, F-score."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pseudolidar.evaluation.cloud_distances import CloudDistances
from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins, in_bin
from pseudolidar.evaluation.comparison.bootstrap import FrameBootstrap, Interval, interval
from pseudolidar.evaluation.comparison.figures import Pooled, Resampled, Statistics
from pseudolidar.evaluation.comparison.points import joined
from pseudolidar.structures.arrays import Float64, Int64

# Distances up to which a point counts as right.
F_RADII_M = (0.1, 0.2, 0.5)


@dataclass(frozen=True)
class CloudFigures:
    """Distances between two clouds; None where one of them has no point.

    Args:
        n: points of the estimate.
        reference: points of the reference.
        figures: `accuracy_m`, `accuracy_median_m`, `accuracy_p90_m`: distance of the estimate's
            points to the reference, mean, median and 90th percentile; `completeness_...` the other
            way round; `chamfer_m` the mean of both means; `precision_0_1` the share of the
            estimate's points within 0.1 m of the reference, `recall_0_1` the other way round,
            `f_score_0_1` their harmonic mean; and so on for 0.2 and 0.5 m.
        intervals: 95 % intervals over frames, by the same names.
    """

    n: int
    reference: int
    figures: Mapping[str, float | None]
    intervals: Mapping[str, Interval] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Counts and figures side by side."""
        bounds = {name: list(pair) for name, pair in self.intervals.items()}
        counts = {"reference_points": self.reference, "n": self.n}
        return {**counts, **self.figures, "intervals": bounds}


@dataclass(frozen=True)
class CloudComparison:
    """Clouds of frames against those of a reference, pooled over points.

    Args:
        subject: what was compared, one line.
        reference: with what.
        frames: how many.
        bins: of the range from the sensor, of each point itself.
        overall: from the first bin to the last.
        by_range: of every bin.
    """

    subject: str
    reference: str
    frames: int
    bins: DepthBins
    overall: CloudFigures
    by_range: tuple[CloudFigures, ...]

    def as_dict(self) -> dict[str, Any]:
        """Pooled figures first, then bins."""
        low, high = self.bins.range_m
        return {
            "subject": self.subject,
            "reference": self.reference,
            "frames": self.frames,
            "from_m": low,
            "to_m": high,
            **self.overall.as_dict(),
            "bins": [
                {"from_m": bin_m[0], "to_m": bin_m[1], **each.as_dict()}
                for bin_m, each in zip(self.bins, self.by_range, strict=True)
            ],
        }


def clouds_of_frames(
    frames: Sequence[ComparedFrame], *, subject: str = "", reference: str = "", bins: DepthBins
) -> CloudComparison | None:
    """The figures of those frames that have distances between clouds; None where none has.

    Args:
        frames: that were compared.
        subject: what was compared, one line.
        reference: with what.
        bins: of the range from the sensor.
    """
    found = [frame.distances for frame in frames if frame.distances is not None]
    if not found:
        return None
    return compare_clouds(found, subject=subject, reference=reference, bins=bins)


def compare_clouds(
    frames: Sequence[CloudDistances],
    *,
    subject: str = "",
    reference: str = "",
    bins: DepthBins = DEFAULT_BINS,
) -> CloudComparison:
    """All figures of frames, at least one.

    Args:
        frames: of `cloud_distances` or `distances_to_scan`.
        subject: what was compared, one line.
        reference: with what.
        bins: of the range from the sensor.
    """
    sides = (
        _Side.of([(f.accuracy_m, f.estimate_range_m) for f in frames]),
        _Side.of([(f.completeness_m, f.reference_range_m) for f in frames]),
    )
    bootstrap = FrameBootstrap(len(frames))
    overall, *by_range = (_figures(sides, bin_m, bootstrap) for bin_m in (bins.range_m, *bins))
    return CloudComparison(subject, reference, len(frames), bins, overall, tuple(by_range))


@dataclass(frozen=True, eq=False)
class _Side:
    """Points of one of the clouds, of all frames."""

    distance_m: Float64
    range_m: Float64
    frame: Int64

    @classmethod
    def of(cls, frames: Sequence[tuple[Float64, Float64]]) -> _Side:
        lengths = [len(distance_m) for distance_m, _ in frames]
        frame = np.repeat(np.arange(len(frames)), lengths)
        return cls(joined([d for d, _ in frames]), joined([r for _, r in frames]), frame)

    def inside(self, bin_m: tuple[int, int]) -> _Side:
        chosen = in_bin(self.range_m, bin_m)
        return _Side(self.distance_m[chosen], self.range_m[chosen], self.frame[chosen])


def _figures(
    sides: tuple[_Side, _Side], bin_m: tuple[int, int], bootstrap: FrameBootstrap
) -> CloudFigures:
    estimate, reference = (side.inside(bin_m) for side in sides)
    n, m = len(estimate.frame), len(reference.frame)
    pooled = _estimates(estimate, reference, Pooled(n, n), Pooled(m, m))
    figures = {name: float(v) if np.isfinite(v) else None for name, v in pooled.items()}
    intervals: dict[str, Interval] = {}
    if bootstrap.frames > 1:
        each = (Resampled(bootstrap, side.frame, side.frame) for side in (estimate, reference))
        resampled = _estimates(estimate, reference, *each)
        bounds = {name: interval(values) for name, values in resampled.items()}
        intervals = {name: found for name, found in bounds.items() if found is not None}
    return CloudFigures(n, m, figures, intervals)


def _estimates(
    estimate: _Side, reference: _Side, of_estimate: Statistics, of_reference: Statistics
) -> dict[str, Float64]:
    found: dict[str, Float64] = {}
    for name, side, statistics in (
        ("accuracy", estimate, of_estimate),
        ("completeness", reference, of_reference),
    ):
        median, p90 = statistics.quantiles(side.distance_m, 0.5, 0.9)
        found[f"{name}_m"] = statistics.mean(side.distance_m)
        found |= {f"{name}_median_m": median, f"{name}_p90_m": p90}
    found["chamfer_m"] = (found["accuracy_m"] + found["completeness_m"]) / 2
    for radius_m in F_RADII_M:
        ending = f"{radius_m:g}".replace(".", "_")
        near = [(side.distance_m <= radius_m).astype(float) for side in (estimate, reference)]
        precision, recall = of_estimate.mean(near[0]), of_reference.mean(near[1])
        both = precision + recall
        score = np.where(both > 0, 2 * precision * recall / np.where(both > 0, both, 1), both)
        found |= {f"precision_{ending}": precision, f"recall_{ending}": recall}
        found[f"f_score_{ending}"] = np.asarray(score)
    return found
