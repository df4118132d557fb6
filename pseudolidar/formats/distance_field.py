"""Distances to the nearest obstacle as NPZ."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.structures.occupancy_grid import OccupancyGrid


def write_distance_field(path: Path, grid: OccupancyGrid) -> None:
    """Write `distance_m` (H, W) with the `resolution_m` and `origin_m` of the grid's cells.

    Rows are along y and columns along x, from `origin_m`; NaN is unknown, inf is no obstacle.

    Raises:
        OutputError: it cannot be written.
    """
    file = io.BytesIO()
    np.savez_compressed(
        file,
        distance_m=grid.distance_m(),
        resolution_m=np.float64(grid.resolution_m),
        origin_m=np.array(grid.origin_m),
        frame=np.array(grid.frame),
    )
    write_atomic(path, file.getvalue())
