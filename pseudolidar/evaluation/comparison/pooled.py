"""Several comparisons as one: their points pooled, each with its own rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pseudolidar.evaluation.comparison.bins import DepthBins, in_bin
from pseudolidar.evaluation.comparison.bootstrap import FrameBootstrap
from pseudolidar.evaluation.comparison.comparison import Comparison, dict_of
from pseudolidar.evaluation.comparison.figures import (
    DepthFigures,
    RangeFigures,
    depth_figures,
    figures_by_range,
)
from pseudolidar.evaluation.comparison.points import ComparedPoints


@dataclass(frozen=True)
class PooledFigures:
    """Figures of the points of several comparisons.

    Args:
        frames: number of frames.
        bins: of the reference's depth.
        overall: of all points from the first bin to the last.
        by_range: of every bin.
    """

    frames: int
    bins: DepthBins
    overall: DepthFigures
    by_range: tuple[RangeFigures, ...]

    def as_dict(self) -> dict[str, Any]:
        """Pooled figures and bins, as those of a single comparison."""
        return {"frames": self.frames, **dict_of(self.bins, self.overall, self.by_range)}


def pooled(comparisons: Sequence[Comparison]) -> PooledFigures:
    """Figures of all points; every comparison has the same bins, and there is at least one."""
    bins = comparisons[0].bins
    points = ComparedPoints.of([frame for each in comparisons for frame in each.frames])
    points = points[in_bin(points.reference_m, bins.range_m)]
    bootstrap = FrameBootstrap(points.frames)
    overall = depth_figures(points, bootstrap)
    return PooledFigures(points.frames, bins, overall, figures_by_range(points, bins, bootstrap))
