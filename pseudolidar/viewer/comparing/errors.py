"""Two clouds of a scene against each other, by range, with the figures of `compare`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from pseudolidar.evaluation.cloud_distances import CloudDistances, cloud_distances
from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins, in_bin
from pseudolidar.evaluation.comparison.clouds import CloudFigures, compare_clouds
from pseudolidar.evaluation.comparison.figures import DepthFigures, depth_figures, figures_by_range
from pseudolidar.evaluation.comparison.points import ComparedPoints
from pseudolidar.geometry.twists import inverted
from pseudolidar.running.comparing.clouds import MOST_ASKED
from pseudolidar.running.comparing.references import OwnKind
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.comparing.standing import are_standing, standing_distances
from pseudolidar.viewer.judged import compared_of, reference_of
from pseudolidar.viewer.moment import VELODYNE, Moment
from pseudolidar.viewer.thinned import thinned

# What depths can be judged by that is no cloud of the scene.
TRUTH_NAME = "ground truth"
KINDS: Mapping[str, OwnKind] = {VELODYNE: "scan", TRUTH_NAME: "truth"}
# Neighbours in maps are looked for among so many points, so far around the rig, m.
MOST_NEIGHBOURS, AROUND_M = 2_000_000, 100.0

# What is known of one frame: depths at reference points, or distances between two clouds.
Evidence = ComparedFrame | CloudDistances


@dataclass(frozen=True)
class RangeRow:
    """Errors of one range.

    Args:
        from_m: nearest, inclusive.
        to_m: farthest, exclusive.
        n: points that were compared.
        median: half of the errors are smaller: a share of the depth, or m.
        p90: nine of ten are.
        bias: signed median; > 0 where points are too far. None of distances, which have no sign.
        covered: share of the reference that there is a point for: at its pixel, or within 0.2 m.
    """

    from_m: int
    to_m: int
    n: int
    median: float | None
    p90: float | None
    bias: float | None
    covered: float | None

    @classmethod
    def of_depths(cls, bin_m: tuple[int, int], figures: DepthFigures) -> Self:
        """Of depths at reference points."""
        return cls(
            *bin_m,
            figures.n,
            figures.median_rel,
            figures.p90_rel,
            figures.bias_rel,
            figures.density,
        )

    @classmethod
    def of_clouds(cls, bin_m: tuple[int, int], figures: CloudFigures) -> Self:
        """Of distances between clouds."""
        found = figures.figures
        return cls(
            *bin_m,
            figures.n,
            found["accuracy_median_m"],
            found["accuracy_p90_m"],
            None,
            found["recall_0_2"],
        )


@dataclass(frozen=True)
class ErrorsByRange:
    """What two clouds differ by.

    Args:
        name: of the one that is judged.
        against: of the other.
        way: whether errors are of depths, relative to them, or distances to the nearest point, m.
        frames: that the figures are of.
        overall: of all ranges together.
        rows: of each range.
    """

    name: str
    against: str
    way: Literal["depth", "distance"]
    frames: int
    overall: RangeRow
    rows: tuple[RangeRow, ...]


def evidence(
    moment: Moment, stills: Mapping[str, PointCloud], name: str, against: str
) -> Evidence | None:
    """What one frame says about one cloud against another; None where it says nothing.

    A stereo cloud and the scan or the truth of its pair are compared by depth, as `compare SOURCE`
    does; any other two by nearest neighbours, as `compare CLOUDS OTHER` does, maps that no rig
    stands in with all their points.

    Args:
        moment: the frame.
        stills: clouds that lie still in the map.
        name: of the cloud that is judged.
        against: of the cloud that it is judged by, or the name of the truth.

    Raises:
        CalibrationField: nobody knows where the scan was taken.
    """
    if against in KINDS:
        compared = compared_of(moment.makings.get(name), KINDS[against])
        if compared is not None:
            return compared
    own, other = (_around_the_rig(moment, stills, each) for each in (name, against))
    if own is None or other is None:
        return None
    if are_standing(moment, stills, name, against):
        return standing_distances(own, other)
    return cloud_distances(own, other, most=MOST_ASKED)


def _around_the_rig(moment: Moment, stills: Mapping[str, PointCloud], name: str) -> Float64 | None:
    """(N, 3) points as seen from the rig, x forward; None where there is no such cloud."""
    if name in moment.clouds:
        return moment.clouds[name].xyz.astype(np.float64)
    if name not in stills:
        return None
    cloud, T_map_rig = thinned(stills[name], MOST_NEIGHBOURS), moment.T_map_forward
    if T_map_rig is None:
        return cloud.xyz.astype(np.float64)
    T = inverted(T_map_rig)
    xyz = cloud.xyz.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    return np.asarray(xyz[np.linalg.norm(xyz, axis=1) < AROUND_M])


def errors_by_range(
    name: str, against: str, frames: Sequence[Evidence], bins: DepthBins = DEFAULT_BINS
) -> ErrorsByRange | None:
    """Figures of what frames say, pooled over their points; None where they say nothing.

    Args:
        name: of the cloud that is judged.
        against: of the other.
        frames: of one kind; others than the first one's are left out.
        bins: of the reference's depth, or of the point's range.
    """
    depths = [each for each in frames if isinstance(each, ComparedFrame)]
    if depths:
        points = ComparedPoints.of(depths)
        inside = points[in_bin(points.reference_m, bins.range_m)]
        overall = RangeRow.of_depths(bins.range_m, depth_figures(inside))
        rows = tuple(
            RangeRow.of_depths((each.from_m, each.to_m), each.figures)
            for each in figures_by_range(points, bins)
        )
        return ErrorsByRange(name, against, "depth", len(depths), overall, rows)
    clouds = [each for each in frames if isinstance(each, CloudDistances)]
    if not clouds:
        return None
    compared = compare_clouds(clouds, bins=bins)
    return ErrorsByRange(
        name,
        against,
        "distance",
        len(clouds),
        RangeRow.of_clouds(bins.range_m, compared.overall),
        tuple(map(RangeRow.of_clouds, bins, compared.by_range)),
    )


def judged_by(moment: Moment, name: str) -> tuple[str, ...]:
    """What the depths of a stereo cloud can be judged by, the best first: scan, truth."""
    made = moment.makings.get(name)
    return tuple(against for against, kind in KINDS.items() if reference_of(made, kind) is not None)
