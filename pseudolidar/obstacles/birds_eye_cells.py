"""Pixels gathered into cells as seen from above, and cells that touch into clusters.

DBSCAN on a grid: a cell is a core where enough of its height is filled with pixels, and cores that
are near one another are of one cluster. Cells follow how stereo sees: some pixels wide, and as deep
as points of one surface may lie apart, which grows with the square of the depth.

Source: Ester et al., A Density-Based Algorithm for Discovering Clusters, KDD 1996.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Bool, Float32, Float64, Int64, UInt8

# A cell is so many pixels wide, and its core is filled to such a height, m.
CELL_PX, FILLED_M = 4, 0.15
# How high a pixel is: too low to make a core; between; in the uppermost part of what makes cores;
# higher, where it belongs to a thing only if this share of that thing's cells fill that share of
# the uppermost part.
LOW, MIDDLE, TOP, HIGHER = range(4)
TOP_M, MOSTLY, FULL = 0.6, 0.5, 0.6
# A cell is as deep as the reach, and this many sigmas of a depth.
SIGMAS = 1.5
# The angle whose tangent ends the rows: a cell ends at infinity at most.
STEEPEST = 1.57


@dataclass(frozen=True)
class Cells:
    """The grid.

    Args:
        reach_m: what is nearer to each other than this is connected.
        own: sigma of a depth over its square, 1/m.
        focal_px: horizontal.
        focal_down_px: vertical.
    """

    reach_m: float
    own: float
    focal_px: float
    focal_down_px: float

    @classmethod
    def of(cls, sight: Sight, reach_m: float, own: float) -> Cells:
        """Cells for the camera of a sight."""
        K = sight.camera.K
        return cls(reach_m, own, float(K[0, 0]), float(K[1, 1]))

    def clusters(self, depth: Float32, standing: Bool, level: UInt8) -> Int64:
        """(H, W) number of the cluster of each pixel that stands, from 1; 0 is none.

        Args:
            depth: (H, W) Z in m.
            standing: (H, W) pixels that may belong to something.
            level: (H, W) `LOW`, `MIDDLE`, `TOP` or `HIGHER`.
        """
        result = np.zeros(depth.shape, np.int64)
        v, u = np.nonzero(standing)
        if not len(v):
            return result
        z, level = depth[v, u], level[v, u]
        row, column = self._row(z), u // CELL_PX
        size = int(row.max()) + 1, depth.shape[1] // CELL_PX + 1
        cell = row * size[1] + column
        middle = self._depth(np.arange(size[0], dtype=np.float64) + 0.5)
        pixel_m = (middle / (self.focal_down_px * CELL_PX))[:, None]

        def filled_m(inside: Bool) -> Float64:
            counts = np.bincount(cell[inside], minlength=size[0] * size[1])
            return np.asarray(counts.reshape(size) * pixel_m)

        core = filled_m((level == MIDDLE) | (level == TOP)) >= FILLED_M
        goes_on = filled_m(level == TOP) >= FULL * TOP_M
        numbers = self._numbered(core, middle)
        reaching = np.bincount(numbers[core & goes_on], minlength=numbers.max() + 1)
        tall = reaching >= MOSTLY * np.bincount(numbers[core], minlength=len(reaching))
        number = numbers.reshape(-1)[cell]
        result[v, u] = np.where((level != HIGHER) | tall[number], number, 0)
        return result

    def _numbered(self, core: Bool, middle_m: Float64) -> Int64:
        """Cells with the number of their cluster; those beside a core join it, and join nothing."""
        import cv2

        _, numbers = cv2.connectedComponents(self._widened(core, middle_m), connectivity=8)
        numbers[~core] = 0
        border = cv2.dilate(numbers.astype(np.float32), np.ones((3, 3), np.uint8))
        return np.where(core, numbers, border.astype(np.int64))

    def _widened(self, core: Bool, middle_m: Float64) -> UInt8:
        """Cores with half of the reach to either side: those that are near touch."""
        import cv2

        wide = core.astype(np.uint8)
        for row, depth_m in zip(wide, middle_m, strict=True):
            half = int(0.5 * self.reach_m * self.focal_px / (depth_m * CELL_PX))
            if half and row.any():
                row[:] = cv2.dilate(row[None], np.ones((1, 2 * half + 1), np.uint8))[0]
        return wide

    @property
    def _bend(self) -> float:
        """Depth over which the error of depths counts as much as the reach, 1/m."""
        return float(np.sqrt(SIGMAS * self.own / self.reach_m))

    def _row(self, depth_m: Float32) -> Int64:
        """Rows: the integral of dz / (reach + sigmas * own * z^2)."""
        bend = self._bend
        rows = np.arctan(depth_m * bend) / (self.reach_m * bend)
        return np.asarray(rows, np.int64)

    def _depth(self, row: Float64) -> Float64:
        bend = self._bend
        return np.asarray(np.tan(np.minimum(row * self.reach_m * bend, STEEPEST)) / bend)
