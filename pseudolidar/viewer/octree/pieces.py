"""All points of an octree, or those near a place, a part of them at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.octree.tree import Octree

# Points of a piece: of some MB, made in some ms.
PIECE_POINTS = 50_000
# Coordinates up to here are as exact as half a millimetre in float32, m.
FLOAT32_REACH_M = 4096.0


@dataclass(frozen=True, eq=False)
class Near:
    """Points of an octree around a place.

    Args:
        cloud: float64.
        there: how many there are, of which the cloud has the coarsest where they are too many.
    """

    cloud: PointCloud
    there: int


def in_pieces(tree: Octree, numbers: Int64 | None = None) -> Iterator[PointCloud]:
    """The points of some nodes, or of all, the coarsest first.

    Coordinates are float32 where that is as good, for all pieces or none.

    Args:
        tree: any.
        numbers: of the nodes.
    """
    if numbers is None:
        numbers = np.arange(len(tree.nodes))
    counts = np.cumsum(tree.nodes["count"][numbers])
    which = np.split(numbers, np.flatnonzero(np.diff(counts // PIECE_POINTS)) + 1)
    small = _reach_m(tree) < FLOAT32_REACH_M
    for part in which:
        cloud = tree.cloud(part.tolist())
        yield replace(cloud, xyz=cloud.xyz.astype(np.float32)) if small else cloud


def points_of(tree: Octree, numbers: Int64) -> int:
    """How many points some nodes have."""
    return int(tree.nodes["count"][numbers].sum())


def near(tree: Octree, place_m: Float64 | None, reach_m: float, *, most: int) -> Near:
    """Points of the nodes that come as near to a place, some beyond it among them.

    Args:
        tree: any.
        place_m: (3,); None for everywhere.
        reach_m: how near.
        most: points at most, if the first level has no more.
    """
    numbers = np.arange(len(tree.nodes))
    if place_m is not None:
        middles, halves = tree.boxes_m
        beside = np.maximum(np.abs(middles - place_m) - halves, 0)
        numbers = np.flatnonzero(np.linalg.norm(beside, axis=1) <= reach_m)
    counts = np.cumsum(tree.nodes["count"][numbers])  # the coarsest come first
    some = numbers[counts <= most]
    return Near(tree.cloud(some.tolist()), points_of(tree, numbers))


def _reach_m(tree: Octree) -> float:
    if not len(tree.nodes):
        return 0.0
    middles, halves = tree.boxes_m
    return float((np.abs(middles) + halves).max())
