"""Maps against each other, where no rig stands in them."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from pseudolidar.evaluation.cloud_distances import CloudDistances, distances_between
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins
from pseudolidar.running.comparing.clouds import MOST_ASKED
from pseudolidar.structures.arrays import Float64
from pseudolidar.viewer.moment import Moment


def are_standing(moment: Moment, stills: Collection[str], *names: str) -> bool:
    """Whether clouds lie still, and nobody knows from where they would be seen."""
    return moment.T_map_forward is None and all(name in stills for name in names)


def standing_distances(own: Float64, other: Float64) -> CloudDistances:
    """Nearest neighbours of all points, whoever could see them; ranges are from the other's middle.

    Args:
        own: (N, 3) m.
        other: (M, 3) m, in the same frame.
    """
    middle_m = np.median(other, axis=0) if len(other) else np.zeros(3)
    everything = np.ones(len(own), np.bool_), np.ones(len(other), np.bool_)
    return distances_between(own - middle_m, other - middle_m, asked=everything, most=MOST_ASKED)


def reaching(frames: Iterable[CloudDistances], bins: DepthBins = DEFAULT_BINS) -> DepthBins:
    """Bins that hold all points: after the last one each is twice as far."""
    farthest_m = max(
        (
            float(ranges.max(initial=0))
            for each in frames
            for ranges in (each.estimate_range_m, each.reference_range_m)
        ),
        default=0.0,
    )
    edges_m = list(bins.edges_m)
    while edges_m[-1] <= farthest_m:
        edges_m.append(2 * edges_m[-1])
    return DepthBins(tuple(edges_m))
