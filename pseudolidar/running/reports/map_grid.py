"""The flat map for robots in pictures: where one can drive, and how far obstacles are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.plots.style import BLUE, new_figure
from pseudolidar.evaluation.page import Picture, PictureRow, Section
from pseudolidar.running.mapped.trajectory_files import body_poses_of
from pseudolidar.running.mapped.walked import Piece
from pseudolidar.structures.arrays import AnyArray, Float64, UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHITE, BLACK, GREY = (254, 254, 254), (0, 0, 0), (205, 205, 205)
# Larger grids are drawn by fewer cells, each as the worst of those that it stands for.
MOST_CELLS = 1500
# Distances are told apart up to here, m.
FAR_M = 5.0
# Width of each of the two, inch.
LEFT_IN = 5.6
ABOUT_GRID = (
    "Seen from above, for robots: white is free ground, black something that stands on it, grey "
    "was not seen or may be either. The blue line is the way that was driven. grid.yaml and "
    "grid.pgm are this picture for map_server and nav2; distances.npz tells of each cell how far "
    "the nearest obstacle is."
)


def grid_sections(
    grid: OccupancyGrid | None, pieces: Sequence[Piece], rig: StereoRig
) -> list[Section]:
    """The grid and its distances; none where no grid was made.

    Args:
        grid: in the map.
        pieces: of path, the longest first.
        rig: places the camera on the body.
    """
    if grid is None:
        return []
    size = f"cells of {grid.resolution_m:g} m"
    picture = Picture.painted(
        _drawn(grid, body_poses_of(pieces[0], rig)[:, :2, 3]),
        f"free, occupied and unknown {size}; metres to the nearest obstacle, up to {FAR_M:g}",
    )
    return [Section("Where a robot can go", ABOUT_GRID, pictures=[PictureRow((picture,))])]


def cells_picture(cells: UInt8) -> UInt8:
    """(H, W, 3) RGB of cells, as map_server shows them; rows still along y."""
    picture = np.empty((*cells.shape, 3), np.uint8)
    picture[:] = GREY
    picture[cells == FREE], picture[cells == OCCUPIED] = WHITE, BLACK
    return picture


def _drawn(grid: OccupancyGrid, way: Float64) -> Figure:
    every = -(-max(grid.cells.shape) // MOST_CELLS)
    far = _least(grid.distance_m(), every)
    shapes = (cells_picture(_worst(grid.cells, every)), far)
    height, width = far.shape
    high_in = float(np.clip(LEFT_IN * height / width + 0.9, 2.4, 9.0))
    figure, panels = new_figure(2 * LEFT_IN, high_in, ncols=2, sharex=True, sharey=True)
    (x, y), side = grid.origin_m, grid.resolution_m * every
    extent = (x, x + width * side, y, y + height * side)
    for axes, pixels in zip(panels, shapes, strict=True):
        kept = {"origin": "lower", "interpolation": "nearest", "vmin": 0.0, "vmax": FAR_M}
        shown = axes.imshow(pixels, extent=extent, **kept)
        axes.plot(*way.T, color=BLUE, linewidth=1.4)
        axes.plot(*way[0], "o", color=BLUE, markersize=5)
        axes.set(xlabel="x of the map, m", facecolor="#cdcdcd")
        axes.grid(visible=False)
    panels[0].set_ylabel("y of the map, m")
    figure.colorbar(shown, ax=panels, shrink=0.8, label="to the nearest obstacle, m")
    return figure


def _worst(cells: UInt8, every: int) -> UInt8:
    """Blocks of cells: occupied where one is, free where one is and none is occupied."""
    blocks = _blocks(cells, every, np.uint8(255))
    free = np.where((blocks == FREE).any(axis=(1, 3)), FREE, 255)
    return np.where((blocks == OCCUPIED).any(axis=(1, 3)), OCCUPIED, free).astype(np.uint8)


def _least(distance_m: AnyArray, every: int) -> AnyArray:
    """The least distance of each block, up to the farthest told apart; NaN where none is known."""
    blocks = _blocks(
        np.where(np.isinf(distance_m), FAR_M, np.nan_to_num(distance_m, nan=np.inf)), every, np.inf
    )
    least = blocks.min(axis=(1, 3))
    return np.where(np.isfinite(least), least, np.nan)


def _blocks(values: AnyArray, every: int, beyond: np.generic | float) -> AnyArray:
    """(H, every, W, every)."""
    height, width = (-(-n // every) * every for n in values.shape)
    padded = np.full((height, width), beyond, values.dtype)
    padded[: values.shape[0], : values.shape[1]] = values
    return padded.reshape(height // every, every, width // every, every)
