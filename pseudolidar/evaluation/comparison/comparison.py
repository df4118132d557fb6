"""The comparison of frames with their references: every figure, profile and cause in one noun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins, in_bin
from pseudolidar.evaluation.comparison.bootstrap import FrameBootstrap
from pseudolidar.evaluation.comparison.clouds import CloudComparison, clouds_of_frames
from pseudolidar.evaluation.comparison.figures import (
    DepthFigures,
    RangeFigures,
    depth_figures,
    figures_by_range,
)
from pseudolidar.evaluation.comparison.points import ComparedPoints
from pseudolidar.evaluation.comparison.profiles import (
    DisparityErrorBin,
    error_by_column,
    error_by_disparity,
)
from pseudolidar.evaluation.comparison.speeds import forward_speeds
from pseudolidar.evaluation.diagnosis.diagnosis import Diagnosis, diagnose
from pseudolidar.evaluation.diagnosis.timing import TimeOffset, time_offset
from pseudolidar.evaluation.sigma import SparsificationCurve, sparsification_curve


@dataclass(frozen=True)
class FrameFigures:
    """Figures of one frame.

    Args:
        id: the source's name of the frame.
        index: its position in the source.
        timestamp_ns: time of the picture.
        overall: of all its points from the first bin to the last.
        by_range: of every bin.
    """

    id: str
    index: int
    timestamp_ns: int
    overall: DepthFigures
    by_range: tuple[RangeFigures, ...]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Stereo against a reference, pooled over the points of all frames.

    Args:
        subject: what was compared, one line.
        reference: with what, in words ("LiDAR scans").
        bins: of the reference's depth.
        frames: what the figures are of: every reference point, frame by frame.
        overall: of all points from the first bin to the last.
        by_range: of every bin.
        by_column: disparity error in strips of the image.
        by_disparity: disparity error by disparity.
        sparsification: how well sigma orders the points by their error; None without sigma.
        per_frame: figures of each frame.
        diagnosis: what is wrong with the rig; None where there are too few points.
        timing: whether scans are of another moment; None unless they are scans, and the source
            has poses.
        clouds: distances between the clouds of both; None where the reference is no cloud.
    """

    subject: str
    reference: str
    bins: DepthBins
    frames: tuple[ComparedFrame, ...]
    overall: DepthFigures
    by_range: tuple[RangeFigures, ...]
    by_column: tuple[DisparityErrorBin, ...]
    by_disparity: tuple[DisparityErrorBin, ...]
    sparsification: SparsificationCurve | None
    per_frame: tuple[FrameFigures, ...]
    diagnosis: Diagnosis | None
    timing: TimeOffset | None
    clouds: CloudComparison | None

    def as_dict(self) -> dict[str, Any]:
        """Pooled figures first, then bins, profiles, sigma and causes."""
        diagnosis = self.diagnosis
        return {
            "subject": self.subject,
            "reference": self.reference,
            "frames": len(self.per_frame),
            **dict_of(self.bins, self.overall, self.by_range),
            "by_column": [strip.as_dict() for strip in self.by_column],
            "by_disparity": [band.as_dict() for band in self.by_disparity],
            "sparsification": self.sparsification and self.sparsification.as_dict(),
            "diagnosis": diagnosis and {"text": diagnosis.text(), **diagnosis.as_dict()},
            "time_offset": self.timing and self.timing.as_dict(),
            "clouds": self.clouds and self.clouds.as_dict(),
        }


def dict_of(
    bins: DepthBins, overall: DepthFigures, by_range: tuple[RangeFigures, ...]
) -> dict[str, Any]:
    """Figures of all points at the top, those of every bin under `bins`."""
    return {
        "from_m": bins.range_m[0],
        "to_m": bins.range_m[1],
        **_renamed(overall.as_dict()),
        "bins": [_renamed(figures.as_dict()) for figures in by_range],
    }


def _renamed(figures: dict[str, Any]) -> dict[str, Any]:
    # `reference` counts points there; at the top it says what was compared with.
    return {"reference_points" if k == "reference" else k: v for k, v in figures.items()}


def compare_frames(
    frames: Sequence[ComparedFrame],
    *,
    subject: str = "",
    reference: str = "",
    bins: DepthBins = DEFAULT_BINS,
    scanned: bool = True,
) -> Comparison:
    """All figures of frames that were compared with their references, at least one frame.

    Args:
        frames: of one rig, in order of time.
        subject: what they are of, for people.
        reference: what they were compared with, for people.
        bins: of the reference's depth.
        scanned: whether the reference is LiDAR scans, which may be of another moment.
    """
    points = ComparedPoints.of(frames)
    points = points[in_bin(points.reference_m, bins.range_m)]
    bootstrap = FrameBootstrap(len(frames))
    matched = points[points.matched]
    timing = None
    if scanned and any(frame.place_m is not None for frame in frames):
        timing = time_offset(frames, forward_speeds(frames))
    return Comparison(
        subject=subject,
        reference=reference,
        bins=bins,
        frames=tuple(frames),
        overall=depth_figures(points, bootstrap),
        by_range=figures_by_range(points, bins, bootstrap),
        by_column=error_by_column(points, frames[0].rig.left.width_px),
        by_disparity=error_by_disparity(points),
        sparsification=None
        if matched.sigma_px is None
        else sparsification_curve(matched.error_px, matched.sigma_px),
        per_frame=tuple(_of_frame(points, number, f, bins) for number, f in enumerate(frames)),
        diagnosis=diagnose(frames),
        timing=timing,
        clouds=clouds_of_frames(frames, subject=subject, reference=reference, bins=bins),
    )


def _of_frame(
    points: ComparedPoints, number: int, frame: ComparedFrame, bins: DepthBins
) -> FrameFigures:
    first, end = np.searchsorted(points.frame, (number, number + 1))
    own = points[slice(int(first), int(end))]
    by_range = figures_by_range(own, bins)
    return FrameFigures(frame.id, frame.index, frame.timestamp_ns, depth_figures(own), by_range)
