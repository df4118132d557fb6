"""Several comparisons as one: their points pooled, each with its own rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.comparison.bins import DepthBins, in_bin
from pseudolidar.evaluation.comparison.bootstrap import FrameBootstrap
from pseudolidar.evaluation.comparison.clouds import CloudComparison, clouds_of_frames
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
        clouds: distances between the clouds of both; None where no reference is a cloud.
    """

    frames: int
    bins: DepthBins
    overall: DepthFigures
    by_range: tuple[RangeFigures, ...]
    clouds: CloudComparison | None

    def as_dict(self) -> dict[str, Any]:
        """Pooled figures and bins, as those of a single comparison."""
        figures = dict_of(self.bins, self.overall, self.by_range)
        return {"frames": self.frames, **figures, "clouds": self.clouds and self.clouds.as_dict()}


class PointPool:
    """Frames of many comparisons, thinned alike as they become too many for the memory.

    Args:
        bins: of the reference's depth.
        most: reference points to keep.
    """

    def __init__(self, bins: DepthBins, *, most: int) -> None:
        self._bins, self._most, self._step = bins, most, 1
        self._frames: list[ComparedFrame] = []

    def add(self, compared: Comparison) -> None:
        """Take the frames of a comparison; of all that are there the same share is kept."""
        self._frames += [frame.every(self._step) for frame in compared.frames]
        while sum(map(len, self._frames)) > self._most:
            self._frames = [frame.every(2) for frame in self._frames]
            self._step *= 2

    def figures(self) -> PooledFigures:
        """Figures of all points, at least one frame."""
        points, bins = ComparedPoints.of(self._frames), self._bins
        points = points[in_bin(points.reference_m, bins.range_m)]
        bootstrap = FrameBootstrap(points.frames)
        overall = depth_figures(points, bootstrap)
        by_range = figures_by_range(points, bins, bootstrap)
        clouds = clouds_of_frames(self._frames, bins=bins)
        return PooledFigures(points.frames, bins, overall, by_range, clouds)
