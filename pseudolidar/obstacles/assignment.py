"""Which obstacle is which track: the likeliest of all assignments, none outside the gate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.obstacles.motion_filter import LASTING, PLACE, Belief, Place
from pseudolidar.obstacles.movers import may_be_one

# 99.9 % of the chi-squared distribution with 3 degrees of freedom.
GATE = 16.27
# An assignment that the gate forbids.
NEVER = 1e6
# Farther than so many of the largest sigma, the gate forbids it surely.
FAR_SIGMAS = 4.1


def assigned(
    beliefs: Sequence[tuple[str, Belief]], places: Sequence[tuple[str, Place]]
) -> list[tuple[int, int]]:
    """Pairs of a track and a place, as many as the gate lets pass, at the least total cost.

    The cost is -2 log likelihood of the place: vague tracks do not take what is a sure one's.

    Args:
        beliefs: class name and belief of each track, at the time of the places.
        places: class name and place of each obstacle.
    """
    from scipy.optimize import linear_sum_assignment

    if not beliefs or not places:
        return []
    cost = np.full((len(beliefs), len(places)), NEVER)
    for row, (name, belief) in enumerate(beliefs):
        for column, (other, place) in enumerate(places):
            if may_be_one(name, other) and _may_be_near(belief, place):
                _, distance, log_volume = belief.seen(place)
                if distance <= GATE:
                    cost[row, column] = distance + log_volume
    rows, columns = linear_sum_assignment(cost)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(row, column) for row, column in pairs if cost[row, column] < NEVER]


def _may_be_near(belief: Belief, place: Place) -> bool:
    """A cheap bound of the gate: no variance is larger than the sum of all."""
    off = place.xyz - belief.mean[PLACE]
    P = belief.covariance
    along_ray = float(place.sigma_m[0]) ** 2 * (1.0 + float(P[LASTING, LASTING]))
    across = float(place.sigma_m[1]) ** 2 + float(place.sigma_m[2]) ** 2
    variance = 2.0 * (float(P[0, 0] + P[1, 1] + P[2, 2]) + along_ray + across)
    return float(off[0] ** 2 + off[1] ** 2 + off[2] ** 2) <= FAR_SIGMAS**2 * variance
