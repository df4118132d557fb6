"""The flat map that wheels need: what stands on the ground, wherever the ground is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float32, Float64, Int64
from pseudolidar.structures.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

# The ground is looked for in squares of this size; in each it is the lowest thing of most columns:
# this percentile, so that single points below it do not count.
SQUARE_M = 2.0
GROUND_PERCENTILE = 25.0
# Log odds from which a voxel counts as taken: 65 %, as map_server and nav2 have it.
TAKEN = 0.62


@dataclass(frozen=True, eq=False)
class Columns:
    """Voxels that say something, by the column that they stand in.

    Args:
        cell: (N, 2) int64 row (y) and column (x), from 0.
        z_m: (N,) float32: where an occupied voxel was hit, the centre of a free one.
        odds: (N,) log odds: above `TAKEN` occupied, below 0 free, else maybe either.
        shape: rows and columns in all.
        first: x, y of cell [0, 0] in cells.
        cell_m: side of a cell.
    """

    cell: Int64
    z_m: Float32
    odds: AnyArray
    shape: tuple[int, int]
    first: tuple[int, int]
    cell_m: float

    @classmethod
    def of(
        cls,
        corners: Int64,
        odds: Float32,
        height: Float32,
        voxel_m: float,
        *,
        voxels_a_cell: int = 1,
    ) -> Columns:
        """From blocks (B, 3) and their voxels (B, 16, 16, 16), axes x, y, z.

        A column is as wide as a cell; where that is several voxels, each of them says its own.
        """
        side = odds.shape[1]
        block, i, j, k = np.nonzero(odds)
        x, y = (corners[block, axis] * side + at for axis, at in ((0, i), (1, j)))
        x, y = x // voxels_a_cell, y // voxels_a_cell
        chance = odds[block, i, j, k]
        centre = (corners[block, 2] * side + k + 0.5) * voxel_m
        z_m = np.where(chance > 0, height[block, i, j, k], centre).astype(np.float32)
        first = (int(x.min(initial=0)), int(y.min(initial=0))) if len(x) else (0, 0)
        shape = (int(y.max()) - first[1] + 1, int(x.max()) - first[0] + 1) if len(x) else (1, 1)
        cell = np.stack([y - first[1], x - first[0]], axis=1)
        return cls(cell, z_m, chance, shape, first, voxel_m * voxels_a_cell)


@dataclass(frozen=True)
class FlatMap:
    """How a flat map is made.

    Args:
        above_m: what is lower above the ground is no obstacle.
        below_m: what is higher is none either.
    """

    above_m: float
    below_m: float

    def grid(self, columns: Columns, frame: str) -> OccupancyGrid:
        """Cells: occupied where something stands in the band, free where air or ground was seen.

        Where something may stand, or nothing was seen, they are unknown.
        """
        ground = ground_height(columns)
        rows, cols = columns.cell.T
        above = columns.z_m - ground[rows, cols]
        in_band = (above >= self.above_m) & (above <= self.below_m)
        cells = np.full(columns.shape, UNKNOWN, np.uint8)
        taken, free = columns.odds > TAKEN, columns.odds < 0
        seen = (in_band & free) | (taken & (np.abs(above) < self.above_m))
        for value, which in (
            (FREE, seen),
            (UNKNOWN, in_band & ~taken & ~free),  # maybe something: not to be driven into
            (OCCUPIED, in_band & taken),
        ):
            cells[rows[which], cols[which]] = value
        origin = tuple(v * columns.cell_m for v in columns.first)
        return OccupancyGrid(cells, columns.cell_m, (origin[0], origin[1]), frame)


def ground_height(columns: Columns) -> Float64:
    """(H, W) z of the ground in each cell, smooth; 0 where nothing at all was seen."""
    from scipy import ndimage

    lowest = np.full(columns.shape, np.inf)
    hit = columns.odds > 0
    np.minimum.at(lowest, tuple(columns.cell[hit].T), columns.z_m[hit])
    lowest[~np.isfinite(lowest)] = np.nan
    if np.isnan(lowest).all():
        return np.zeros(columns.shape)
    squares = _squares(lowest, max(round(SQUARE_M / columns.cell_m), 1))
    missing = np.isnan(squares)
    nearest = ndimage.distance_transform_edt(missing, return_distances=False, return_indices=True)
    squares = ndimage.median_filter(squares[tuple(nearest)], size=3, mode="nearest")
    side = max(round(SQUARE_M / columns.cell_m), 1)
    rows, cols = (((np.arange(n) + 0.5) / side - 0.5) for n in columns.shape)
    at = np.meshgrid(rows, cols, indexing="ij")
    return np.asarray(ndimage.map_coordinates(squares, at, order=1, mode="nearest"))


def _squares(lowest: Float64, side: int) -> Float64:
    """A low percentile of each square of `side` cells; NaN where none of them is known."""
    height, width = (-(-n // side) * side for n in lowest.shape)
    padded = np.full((height, width), np.nan)
    padded[: lowest.shape[0], : lowest.shape[1]] = lowest
    split = padded.reshape(height // side, side, width // side, side).swapaxes(1, 2)
    tiles = split.reshape(height // side, width // side, side * side)
    known = ~np.isnan(tiles).all(axis=2)
    found = np.full(known.shape, np.nan)
    found[known] = np.nanpercentile(tiles[known], GROUND_PERCENTILE, axis=1)
    return found
