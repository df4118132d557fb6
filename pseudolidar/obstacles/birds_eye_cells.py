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

    def clusters(self, depth: Float32, standing: Bool, filled: Bool) -> Int64:
        """(H, W) number of the cluster of each pixel that stands, from 1; 0 is none.

        Args:
            depth: (H, W) Z in m.
            standing: (H, W) pixels that may belong to something.
            filled: (H, W) those of them that make cores.
        """
        import cv2

        v, u = np.nonzero(standing)
        z = depth[v, u]
        row, column = self._row(z), u // CELL_PX
        size = int(row.max()) + 1, depth.shape[1] // CELL_PX + 1
        cell = row * size[1] + column
        counts = np.bincount(cell[filled[v, u]], minlength=size[0] * size[1]).reshape(size)
        middle = self._depth(np.arange(size[0], dtype=np.float64) + 0.5)
        core = counts * (middle / (self.focal_down_px * CELL_PX))[:, None] >= FILLED_M
        _, numbers = cv2.connectedComponents(self._widened(core, middle), connectivity=8)
        numbers[~core] = 0
        # Cells beside a core are its border: they join it, and nothing joins them.
        border = cv2.dilate(numbers.astype(np.float32), np.ones((3, 3), np.uint8))
        numbers = np.where(core, numbers, border.astype(np.int32))
        result = np.zeros(depth.shape, np.int64)
        result[v, u] = numbers.reshape(-1)[cell]
        return result

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
