"""A cloud put into the order of an octree, some points at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pseudolidar.geometry.octree import OctreeOrder, octree_order
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import COLUMNS
from pseudolidar.viewer.octree.tree import EXTRA, INTENSITY, RGB, SIGMA, Octree

# Points that are put in order at a time.
BLOCK = 1 << 20


def places(found: OctreeOrder, cloud: PointCloud) -> Iterator[AnyArray]:
    """(n, 3) float32 m from the middles of the points' nodes.

    Exact for clouds anywhere on Earth: float32 begins at the node. Stray points, which may be far
    from it, are as exact as float32 is there.
    """
    ends = found.nodes["start"] + found.nodes["count"]
    middles_m = found.cube.middles_m(found.nodes)
    for start in range(0, len(found.order), BLOCK):
        rows = found.order[start : start + BLOCK]
        numbers = np.searchsorted(ends, np.arange(start, start + len(rows)), side="right")
        yield (cloud.xyz[rows].astype(np.float64) - middles_m[numbers]).astype(np.float32)


def column(found: OctreeOrder, values: AnyArray) -> Iterator[AnyArray]:
    """A column in the order of the octree."""
    for start in range(0, len(found.order), BLOCK):
        yield values[found.order[start : start + BLOCK]]


def columns_of(cloud: PointCloud) -> dict[str, AnyArray]:
    """What an octree keeps of a cloud besides places: what points can be coloured by."""
    known = {RGB: cloud.rgb, SIGMA: cloud.sigma_m, INTENSITY: cloud.intensity}
    columns: dict[str, AnyArray] = {k: values for k, values in known.items() if values is not None}
    for names in COLUMNS.values():
        for name in names:
            values = cloud.extra.get(name)
            if values is not None and values.ndim == 1 and values.dtype.kind in "fiub":
                columns[EXTRA + name] = values.astype(np.float32)
    return columns


def built(cloud: PointCloud) -> Octree:
    """An octree in memory."""
    found = octree_order(cloud.xyz)
    columns = {k: np.concatenate([*column(found, c), c[:0]]) for k, c in columns_of(cloud).items()}
    far = np.concatenate([*places(found, cloud), np.zeros((0, 3), np.float32)])
    return Octree(found.cube, cloud.frame, found.nodes, far, columns)
