"""How an octree is built: points sorted by their cells, coarse ones first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float64, Int64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import COLUMNS
from pseudolidar.viewer.octree.octree_kernels import (
    DEPTH,
    NOWHERE,
    bounds,
    first_depths,
    in_levels,
    morton_codes,
    node_starts,
    settle_levels,
)
from pseudolidar.viewer.octree.tree import EXTRA, INTENSITY, NODE, RGB, SIGMA, Octree, OctreeShape

# A node with no more points than this is not divided; the first level has at most twice as many.
MOST_IN_NODE = 25_000
# Cells of a node along an edge, as powers of 2.
LEAST_GRID, MOST_GRID = 3, 9
# Points that are put in order at a time.
BLOCK = 1 << 20
SMALLEST_M = 1e-3


@dataclass(frozen=True, eq=False)
class Plan:
    """Where each point of a cloud goes.

    Args:
        shape: the cube.
        nodes: (M,) of dtype `NODE`.
        order: (N,) int64 rows of the cloud in the order of the octree.
    """

    shape: OctreeShape
    nodes: AnyArray
    order: Int64

    def blocks(self) -> Iterator[tuple[slice, Int64]]:
        """Rows of the octree, and those of the cloud that go there, some at a time."""
        for start in range(0, len(self.order), BLOCK):
            rows = slice(start, min(start + BLOCK, len(self.order)))
            yield rows, self.order[rows]

    def places(self, cloud: PointCloud) -> Iterator[AnyArray]:
        """(n, 3) float32 from the middles of nodes, some points at a time."""
        tree = Octree(self.shape, self.nodes, np.zeros((0, 3), np.float32), {})
        ends = self.nodes["start"] + self.nodes["count"]
        for rows, chosen in self.blocks():
            numbers = np.searchsorted(ends, np.arange(rows.start, rows.stop), side="right")
            far = cloud.xyz[chosen].astype(np.float64) - tree.middles_m[numbers]
            yield far.astype(np.float32)

    def column(self, values: AnyArray) -> Iterator[AnyArray]:
        """A column in the order of the octree, some points at a time."""
        for _, chosen in self.blocks():
            yield values[chosen]


def planned(cloud: PointCloud) -> Plan:
    """Find the node of each point that is finite.

    Args:
        cloud: N points; what the work needs besides is 33 bytes a point.
    """
    low, size_m = _cube(cloud.xyz)
    codes = np.empty(len(cloud), np.uint64)
    morton_codes(cloud.xyz, low, size_m, codes)
    order = np.argsort(codes)
    codes = codes[order]
    known = int(np.searchsorted(codes, np.uint64(NOWHERE)))
    codes, order = codes[:known], order[:known]
    levels = np.empty(known, np.uint8)
    first_depths(codes, levels)
    grid = _grid(np.bincount(levels, minlength=DEPTH + 2))
    settle_levels(codes, grid, MOST_IN_NODE, levels)
    by_level = np.empty(known, np.int64)
    in_levels(levels, np.bincount(levels, minlength=DEPTH + 1), by_level)
    nodes = _nodes(codes, levels, by_level)
    x, y, z = low.tolist()
    shape = OctreeShape((x, y, z), size_m, grid, cloud.frame)
    return Plan(shape, nodes, order[by_level])


def built(cloud: PointCloud) -> Octree:
    """An octree in memory."""
    plan = planned(cloud)

    def whole(parts: Iterator[AnyArray], like: AnyArray) -> AnyArray:
        return np.concatenate([*parts, like[:0]])

    columns = {name: whole(plan.column(c), c) for name, c in columns_of(cloud).items()}
    places = whole(plan.places(cloud), np.zeros((0, 3), np.float32))
    return Octree(plan.shape, plan.nodes, places, columns)


def columns_of(cloud: PointCloud) -> dict[str, AnyArray]:
    """What an octree keeps of a cloud besides places: what points can be coloured by."""
    known = {RGB: cloud.rgb, SIGMA: cloud.sigma_m, INTENSITY: cloud.intensity}
    columns: dict[str, AnyArray] = {k: column for k, column in known.items() if column is not None}
    for names in COLUMNS.values():
        for name in names:
            column = cloud.extra.get(name)
            if column is not None and column.ndim == 1 and column.dtype.kind in "fiub":
                columns[EXTRA + name] = column.astype(np.float32)
    return columns


def _cube(xyz: AnyArray) -> tuple[Float64, float]:
    """Corner and edge of a cube around all finite points."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    bounds(xyz, low, high)
    if not np.isfinite(low).all():
        return np.zeros(3), SMALLEST_M
    size_m = max(float((high - low).max()) * (1 + 1e-6), SMALLEST_M)
    return 0.5 * (low + high) - 0.5 * size_m, size_m


def _grid(counts: Int64) -> int:
    """The finest grid of which the first level has not too many points.

    Args:
        counts: points that are the first of their cell from each depth on.
    """
    points = np.cumsum(counts)
    fitting = np.flatnonzero(points <= 2 * MOST_IN_NODE)
    return int(np.clip(fitting[-1] if len(fitting) else 0, LEAST_GRID, MOST_GRID))


def _nodes(codes: AnyArray, levels: AnyArray, by_level: Int64) -> AnyArray:
    begins = np.empty(len(codes), np.uint8)
    nodes = np.zeros(node_starts(codes, levels, by_level, begins), NODE)
    nodes["start"] = np.flatnonzero(begins)
    nodes["count"] = np.diff(np.append(nodes["start"], len(codes)))
    first = by_level[nodes["start"]]
    nodes["level"] = levels[first]
    shifts = 3 * (DEPTH - nodes["level"].astype(np.uint64))
    cells = codes[first] >> shifts
    for axis in range(3):
        nodes["cell"][:, axis] = _every_third(cells >> np.uint64(2 - axis))
    return nodes


def _every_third(codes: AnyArray) -> AnyArray:
    """Bits 0, 3, 6 ... of codes put together."""
    found = np.zeros(len(codes), np.int64)
    for bit in range(DEPTH):
        found |= ((codes >> np.uint64(3 * bit)) & np.uint64(1)).astype(np.int64) << bit
    return found
