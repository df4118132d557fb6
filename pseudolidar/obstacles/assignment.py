"""Which obstacle is which track: the likeliest of all assignments, none outside the gate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.obstacles.motion_filter import ASIDE, LASTING, PLACE, RIG, Belief, Place
from pseudolidar.obstacles.movers import may_be_one
from pseudolidar.obstacles.overlap import BoxPx, box_iou
from pseudolidar.obstacles.placing import goes_on
from pseudolidar.structures.obstacle import Obstacle

# 99.9 % of the chi-squared distribution with 3 degrees of freedom.
GATE = 16.27
# A box that is where it was a moment ago may be farther off: that was a bad measurement, or is one.
WIDE_GATE, SAME_IOU = 4.0 * GATE, 0.5
# What is no surer than this share of its distance may be anywhere, as may what has no end: it is
# the track whose box it has.
VAGUE_SHARE, VAGUE_IOU = 0.2, 0.3
# Cost of boxes that do not overlap, where they are a moment apart.
APART_COST = 10.0
# An assignment that the gate forbids.
NEVER = 1e6
# Farther than so many of the largest sigma, the gate forbids it surely.
FAR_SIGMAS = 8.1


def assigned(
    known: Sequence[tuple[str, Belief, BoxPx | None]],
    seen: Sequence[tuple[Obstacle, Place]],
) -> list[tuple[int, int]]:
    """Pairs of a track and a place, as many as the gate lets pass, at the least total cost.

    The cost is -2 log likelihood of the place: vague tracks do not take what is a sure one's. Cars
    of a row, as far from each other as their errors, are told apart by their boxes of a moment ago.

    Args:
        known: class name and belief of each track at the time of the places, and its box in the
            picture of a moment before, if it was seen then.
        seen: each obstacle and its place.
    """
    from scipy.optimize import linear_sum_assignment

    if not known or not seen:
        return []
    cost = np.full((len(known), len(seen)), NEVER)
    for row, (name, belief, box_px) in enumerate(known):
        for column, (other, place) in enumerate(seen):
            if may_be_one(name, other.detection.name) and _may_be_near(belief, place):
                overlap = 1.0 if box_px is None else box_iou(box_px, other.detection.box_px)
                if overlap < VAGUE_IOU and _is_vague(other):
                    continue
                _, distance, log_volume = belief.seen(place)
                same_px = box_px is not None and overlap >= SAME_IOU
                if distance <= (WIDE_GATE if same_px else GATE):
                    apart = APART_COST * (1.0 - overlap)
                    cost[row, column] = min(distance, GATE) + log_volume + apart
    rows, columns = linear_sum_assignment(cost)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(row, column) for row, column in pairs if cost[row, column] < NEVER]


def _is_vague(obstacle: Obstacle) -> bool:
    unsure = obstacle.sigma_distance_m > VAGUE_SHARE * obstacle.distance_m
    return unsure or obstacle.measured_by == "size" or goes_on(obstacle)


def _may_be_near(belief: Belief, place: Place) -> bool:
    """A cheap bound of the gate: no variance is larger than the sum of all."""
    off = place.xyz - belief.mean[PLACE]
    P = belief.covariance
    along_ray = float(place.sigma_m[0]) ** 2 * (1.0 + float(P[LASTING, LASTING]))
    across = float(place.sigma_m[1]) ** 2 * (1.0 + float(P[ASIDE, ASIDE]))
    own = along_ray + across + float(place.sigma_m[2]) ** 2
    shared = place.shared_m**2 * float(P[RIG, RIG])
    variance = 4.0 * (float(P[0, 0] + P[1, 1] + P[2, 2]) + own + shared)
    return float(off[0] ** 2 + off[1] ** 2 + off[2] ** 2) <= FAR_SIGMAS**2 * variance
