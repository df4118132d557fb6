"""Points sorted by the cells of an octree, those of coarse levels first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float64, Int64

# Halvings of the cube along each axis; 63 bits of a code.
DEPTH = 21
# What is known of a node: its level, the cell of that level, and its points.
NODE = np.dtype([("level", "u1"), ("cell", "<i4", (3,)), ("start", "<i8"), ("count", "<i8")])
# A node with no more points than this is not divided; the first level has at most twice as many.
MOST_IN_NODE = 25_000
# Cells of a node along an edge, as powers of 2.
LEAST_GRID, MOST_GRID = 3, 9
SMALLEST_M = 1e-3
# Stray points do not make all others one cell of the cube: it is around those that are between
# these shares of so many along each axis, or beside them by less than a share of their longest
# extent.
MOST_SAMPLED = 100_000
MOST_POINTS = (0.001, 0.999)
MARGIN = 0.25


@dataclass(frozen=True)
class OctreeCube:
    """The cube of an octree: points outside belong to the cells at its border.

    Args:
        low_m: its corner.
        size_m: its edge.
        grid: a node holds about one point in each of 2^grid cells along an edge.
    """

    low_m: tuple[float, float, float]
    size_m: float
    grid: int

    def spacing_m(self, level: AnyArray) -> Float64:
        """How far apart points of levels are."""
        return np.asarray(self.size_m * 0.5 ** (level.astype(np.float64) + self.grid))

    def half_m(self, level: AnyArray) -> Float64:
        """Half an edge of nodes of levels."""
        return np.asarray(self.size_m * 0.5 ** (level + 1.0))

    def middles_m(self, nodes: AnyArray) -> Float64:
        """(M, 3) middles of nodes (M,) of dtype `NODE`."""
        half = self.half_m(nodes["level"])[:, None]
        return np.asarray(self.low_m + (2 * nodes["cell"] + 1) * half)


@dataclass(frozen=True, eq=False)
class OctreeOrder:
    """Where each point goes.

    Args:
        cube: around all but stray points.
        nodes: (M,) of dtype `NODE`, the coarsest first.
        order: (N,) int64 rows of the points in the order of the octree.
    """

    cube: OctreeCube
    nodes: AnyArray
    order: Int64


def octree_order(xyz: AnyArray) -> OctreeOrder:
    """Find the node of each point that is finite.

    A node has the points that are the first of a cell of its grid, in the order of Morton codes,
    and that no node above it has: to draw a cube finely is to draw the nodes above it as well. One
    with few points left has them all. The few that are far from all others are in nodes at the
    border of the cube, but outside of these.

    Args:
        xyz: (N, 3) m; the work needs 33 bytes a point besides.
    """
    from pseudolidar.geometry.octree_kernels import (
        NOWHERE,
        first_depths,
        in_levels,
        morton_codes,
        settle_levels,
    )

    low, size_m = _cube(xyz)
    codes = np.empty(len(xyz), np.uint64)
    morton_codes(xyz, low, size_m, codes)
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
    return OctreeOrder(OctreeCube((x, y, z), size_m, grid), nodes, order[by_level])


def _cube(xyz: AnyArray) -> tuple[Float64, float]:
    """Corner and edge of a cube around all finite points but stray ones."""
    from pseudolidar.geometry.octree_kernels import bounds

    least, most = np.full(3, -np.inf), np.full(3, np.inf)
    sample = xyz[:: max(len(xyz) // MOST_SAMPLED, 1)].astype(np.float64)
    sample = sample[np.isfinite(sample).all(axis=1)]
    if len(sample):
        near, far = np.quantile(sample, MOST_POINTS, axis=0)
        margin_m = MARGIN * float((far - near).max())
        least, most = near - margin_m, far + margin_m
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    bounds(xyz, least, most, low, high)
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
    from pseudolidar.geometry.octree_kernels import node_starts

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
