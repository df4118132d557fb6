"""An octree of points, coarse levels first, as it lies in memory or in mapped files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float32, Float64, Int64, UInt8
from pseudolidar.structures.cloud import PointCloud

# What is known of a node: its level, the cell of that level, and its points.
NODE = np.dtype([("level", "u1"), ("cell", "<i4", (3,)), ("start", "<i8"), ("count", "<i8")])
# The optional columns of a cloud by the names that they have in an octree.
RGB, SIGMA, INTENSITY, EXTRA = "rgb", "sigma_m", "intensity", "extra."


@dataclass(frozen=True)
class OctreeShape:
    """The cube of an octree.

    Args:
        low_m: its corner in the frame of the cloud.
        size_m: its edge.
        grid: a node holds about one point in each of 2^grid cells along an edge.
        frame: coordinate frame.
    """

    low_m: tuple[float, float, float]
    size_m: float
    grid: int
    frame: str

    def spacing_m(self, level: AnyArray | int) -> AnyArray | float:
        """How far apart points of a level are."""
        return np.asarray(self.size_m * 0.5 ** (np.asarray(level) + self.grid))


@dataclass(frozen=True, eq=False)
class Octree:
    """Points of all levels. To draw a cube finely is to draw all nodes above it as well.

    Args:
        shape: its cube.
        nodes: (M,) of dtype `NODE`, the coarsest first.
        places: (N, 3) float32 m from the middle of each point's node.
        columns: rgb (N, 3) uint8; others (N,) float32.
    """

    shape: OctreeShape
    nodes: AnyArray
    places: Float32
    columns: Mapping[str, AnyArray]

    def __len__(self) -> int:
        return len(self.places)

    @cached_property
    def half_m(self) -> Float64:
        """(M,) half an edge of each node."""
        return np.asarray(self.shape.size_m * 0.5 ** (self.nodes["level"] + 1.0))

    @cached_property
    def middles_m(self) -> Float64:
        """(M, 3) middle of each node in the frame of the cloud."""
        half = self.half_m[:, None]
        return np.asarray(self.shape.low_m + (2 * self.nodes["cell"] + 1) * half)

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

    def spread_m(self, number: int) -> Float32:
        """(n, 3) points of a node from its middle."""
        start, count = self._range(number)
        return np.asarray(self.places[start : start + count])

    def cloud(self, numbers: Iterable[int]) -> PointCloud:
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
            self.shape.frame,
            rgb=rgb,
            intensity=columns.get(INTENSITY),
            sigma_m=columns.get(SIGMA),
            extra=extra,
        )

    def coarsest(self, most: int) -> Int64:
        """Numbers of the nodes of as many whole levels as have at most so many points; the first
        level always."""
        levels = self.nodes["level"]
        points = np.bincount(levels, self.nodes["count"])
        fitting = np.flatnonzero(np.cumsum(points) <= most)
        last = fitting[-1] if len(fitting) else levels.min()
        return np.flatnonzero(levels <= last)

    def _range(self, number: int) -> tuple[int, int]:
        node = self.nodes[number]
        return int(node["start"]), int(node["count"])
