"""An octree of points, coarse levels first, as it lies in memory or in mapped files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pseudolidar.geometry.octree import DEPTH, OctreeCube
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64, Int64, UInt8
from pseudolidar.structures.cloud import PointCloud

# The optional columns of a cloud by the names that they have in an octree.
RGB, SIGMA, INTENSITY, EXTRA = "rgb", "sigma_m", "intensity", "extra."


@dataclass(frozen=True, eq=False)
class Octree:
    """Points of all levels. To draw a cube finely is to draw all nodes above it as well.

    Args:
        cube: around all but stray points, which lie outside of their nodes.
        frame: coordinate frame.
        nodes: (M,) of dtype `geometry.octree.NODE`, the coarsest first.
        places: (N, 3) float32 m from the middle of each point's node.
        columns: rgb (N, 3) uint8; others (N,) float32.
    """

    cube: OctreeCube
    frame: str
    nodes: AnyArray
    places: Float32
    columns: Mapping[str, AnyArray]

    def __len__(self) -> int:
        return len(self.places)

    @cached_property
    def half_m(self) -> Float64:
        """(M,) half an edge of each node."""
        return self.cube.half_m(self.nodes["level"])

    @cached_property
    def middles_m(self) -> Float64:
        """(M, 3) middle of each node in the frame of the cloud."""
        return self.cube.middles_m(self.nodes)

    @cached_property
    def boxes_m(self) -> tuple[Float64, Float64]:
        """(M, 3) middles and (M, 3) half edges of what is filled of nodes and all below them."""
        if not len(self.nodes):
            return np.zeros((0, 3)), np.zeros((0, 3))
        starts = self.nodes["start"]
        low = self.middles_m + np.minimum.reduceat(self.places, starts, axis=0)
        high = self.middles_m + np.maximum.reduceat(self.places, starts, axis=0)
        for number in range(len(starts) - 1, -1, -1):
            above = self.parents[number]
            if above >= 0:
                low[above] = np.minimum(low[above], low[number])
                high[above] = np.maximum(high[above], high[number])
        return 0.5 * (low + high), 0.5 * (high - low)

    @cached_property
    def parents(self) -> Int64:
        """(M,) the next coarser node that holds each; -1 where there is none."""
        known: dict[tuple[int, ...], int] = {}
        parents = np.full(len(self.nodes), -1)
        cells = zip(self.nodes["level"].tolist(), self.nodes["cell"].tolist(), strict=True)
        for number, (level, (x, y, z)) in enumerate(cells):
            known[level, x, y, z] = number
            above = ((level - k, x >> k, y >> k, z >> k) for k in range(1, level + 1))
            parents[number] = next((known[key] for key in above if key in known), -1)
        return parents

    @cached_property
    def whole(self) -> Bool:
        """(M,) nodes that nothing finer lies in."""
        above = self.parents[self.parents >= 0]
        return np.asarray(np.bincount(above, minlength=len(self.nodes)) == 0)

    def apart_m(self, number: int) -> float:
        """How far apart the points of a node are, as they follow one another in it."""
        known = self._apart_m
        if number not in known:
            steps = np.diff(self.spread_m(number), axis=0)
            nominal_m = float(self.cube.spacing_m(self.nodes["level"][number]))
            far_m = np.linalg.norm(steps, axis=1)
            known[number] = min(float(np.median(far_m)), nominal_m) if len(far_m) else nominal_m
        return known[number]

    @cached_property
    def _apart_m(self) -> dict[int, float]:
        return {}

    def spread_m(self, number: int) -> Float32:
        """(n, 3) points of a node from its middle."""
        start, count = self._range(number)
        return np.asarray(self.places[start : start + count])

    def cloud(self, numbers: Sequence[int]) -> PointCloud:
        """The points of some nodes as a cloud, float64."""
        ranges = [self._range(number) for number in numbers]
        if not ranges:
            return self._cloud(np.zeros(0, np.int64), np.zeros(0, np.int64))
        rows = np.concatenate([np.arange(start, start + count) for start, count in ranges])
        counts = [count for _, count in ranges]
        return self._cloud(rows, np.repeat(np.asarray(list(numbers), np.int64), counts))

    def _cloud(self, rows: Int64, numbers: Int64) -> PointCloud:
        columns = {name: np.asarray(column[rows]) for name, column in self.columns.items()}
        extra = {
            name.removeprefix(EXTRA): column
            for name, column in columns.items()
            if name.startswith(EXTRA)
        }
        rgb: UInt8 | None = columns.get(RGB)
        return PointCloud(
            self.middles_m[numbers] + self.places[rows],
            self.frame,
            rgb=rgb,
            intensity=columns.get(INTENSITY),
            sigma_m=columns.get(SIGMA),
            extra=extra,
        )

    def coarsest(self, most: int) -> Int64:
        """Numbers of the nodes of as many whole levels as have at most so many points.

        The first level is always among them.
        """
        levels = self.nodes["level"]
        points = np.bincount(levels, self.nodes["count"])
        fitting = np.flatnonzero(np.cumsum(points) <= most)
        last = fitting[-1] if len(fitting) else levels.min(initial=DEPTH)
        return np.flatnonzero(levels <= last)

    def _range(self, number: int) -> tuple[int, int]:
        node = self.nodes[number]
        return int(node["start"]), int(node["count"])
