"""Which voxels of the world are taken and which are free: log odds, carved by rays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.errors import MemoryLimit
from pseudolidar.mapping import occupancy_kernels as kernels
from pseudolidar.mapping.flat_map import TAKEN, Columns, FlatMap
from pseudolidar.structures.arrays import AnyArray, Float32, Float64, Int64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.occupancy_grid import OccupancyGrid

if TYPE_CHECKING:
    from pseudolidar.mapping.occupancy import Occupancy

# Log odds of one look: an end that is surely in the voxel, and a ray that goes through.
# Source: Hornung et al., OctoMap, 2013 (0.85 and -0.4, clamped to -2 and 3.5).
HIT, PASSED, LEAST, MOST = 0.85, -0.4, -2.0, 3.5
# Bytes of a block: log odds and heights, and the same again while the table grows.
BLOCK_BYTES = 2 * 8 * kernels.BLOCK**3
FIRST_BLOCKS = 256


class OccupancyMap:
    """Blocks of voxels that rays fill; only what was seen takes memory."""

    def __init__(self, settings: Occupancy) -> None:
        self.settings, self.frame = settings, "map"
        self._most = max(settings.memory_mb * 10**6 // BLOCK_BYTES, 1)
        self._row_of: dict[tuple[int, int, int], int] = {}
        self._odds, self._height = self._empty(FIRST_BLOCKS), self._empty(FIRST_BLOCKS)

    @property
    def blocks(self) -> int:
        """Blocks in use."""
        return len(self._row_of)

    def integrate(self, cloud: PointCloud, origin_m: Float64) -> None:
        """Add what one view saw; each voxel counts once, however many rays meet it.

        Args:
            cloud: points in the map's frame, z up; their sigma spreads them along the ray.
            origin_m: (3,) where they were seen from, in the same frame.

        Raises:
            MemoryLimit: more blocks than `memory_mb` holds.
        """
        self.frame = cloud.frame
        valid = cloud.valid
        points = np.ascontiguousarray(cloud.xyz[valid], np.float64)
        if not len(points):
            return
        sigma = np.zeros(len(points), np.float32) if cloud.sigma_m is None else cloud.sigma_m[valid]
        first, rows = self._window(points, origin_m)
        mine = rows[rows >= 0]
        local = np.full_like(rows, -1)
        local[rows >= 0] = np.arange(len(mine))
        hit, height = self._empty(len(mine)), self._empty(len(mine))
        passed = np.zeros(hit.shape, np.uint8)
        kernels.trace(
            points, sigma, origin_m, self.settings.voxel_m, self.settings.far_m, first,
            local, hit, height, passed,
        )  # fmt: skip
        odds = self._odds[mine]
        # The height of a voxel follows the looks at it by their weight against the sureness so far.
        share = hit / np.maximum(hit + np.maximum(odds, 0) / HIT, 1e-6)
        self._height[mine] += np.where(hit > 0, share * (height - self._height[mine]), 0)
        change = np.where(hit > 0, HIT * hit, PASSED * passed)
        self._odds[mine] = np.clip(odds + change, LEAST, MOST)

    def occupied(self) -> PointCloud:
        """Centres of voxels taken by more than 65 %, with column `occupancy`: how surely, 0-1."""
        corners, odds, _ = self._stored()
        block, i, j, k = np.nonzero(odds > TAKEN)
        index = corners[block] * kernels.BLOCK + np.stack([i, j, k], axis=1)
        probability = 1 / (1 + np.exp(-odds[block, i, j, k]))
        xyz = ((index + 0.5) * self.settings.voxel_m).astype(np.float32)
        return PointCloud(xyz, self.frame, extra={"occupancy": probability.astype(np.float32)})

    def flat(self) -> OccupancyGrid:
        """Free, occupied and unknown cells, by what stands between `above_m` and `below_m`."""
        corners, odds, height = self._stored()
        settings = self.settings
        columns = Columns.of(
            corners, odds, height, settings.voxel_m, voxels_a_cell=settings.voxels_a_cell
        )
        return FlatMap(settings.above_m, settings.below_m).grid(columns, self.frame)

    def _window(self, points: Float64, origin_m: Float64) -> tuple[Int64, AnyArray]:
        """First block of the window around a view, and rows (X, Y, Z) of the blocks it needs."""
        block_m, far_m = kernels.BLOCK * self.settings.voxel_m, self.settings.far_m
        low = np.maximum(np.minimum(points.min(0), origin_m), origin_m - far_m)
        high = np.minimum(np.maximum(points.max(0), origin_m), origin_m + far_m)
        first = np.floor(low / block_m).astype(np.int64)
        size = np.floor(high / block_m).astype(np.int64) - first + 1
        used = np.zeros(size, np.uint8)
        kernels.mark_blocks(points, origin_m, block_m, far_m, first, used)
        rows = np.full(size, -1, np.int32)
        for at in np.argwhere(used):
            x, y, z = (at + first).tolist()
            rows[tuple(at)] = self._row_of.setdefault((x, y, z), len(self._row_of))
        self._grow(len(self._row_of))
        return first, rows

    def _grow(self, blocks: int) -> None:
        if blocks > self._most:
            raise MemoryLimit(
                f"an occupancy map of {blocks} blocks of {self.settings.voxel_m:g} m voxels",
                want=f"at most {self.settings.memory_mb} MB",
                fix="Take larger voxels, a smaller far-m, or raise the map's memory-mb.",
            )
        if blocks > len(self._odds):
            more = max(blocks, min(2 * len(self._odds), self._most)) - len(self._odds)
            self._odds = np.concatenate([self._odds, self._empty(more)])
            self._height = np.concatenate([self._height, self._empty(more)])

    def _stored(self) -> tuple[Int64, Float32, Float32]:
        """Coordinates (B, 3), log odds and heights of the blocks in use."""
        corners = np.array(list(self._row_of), np.int64).reshape(-1, 3)
        return corners, self._odds[: self.blocks], self._height[: self.blocks]

    @staticmethod
    def _empty(blocks: int) -> Float32:
        return np.zeros((blocks, *(kernels.BLOCK,) * 3), np.float32)
