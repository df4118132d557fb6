"""What robots need of a map: voxels, a flat map, distances to obstacles."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.formats.distance_field import write_distance_field
from pseudolidar.formats.map_server import write_map_server
from pseudolidar.running.one_cloud import write_cloud
from pseudolidar.structures.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

if TYPE_CHECKING:
    from pseudolidar.mapping.occupancy_map import OccupancyMap

VOXELS, GRID, PICTURE, DISTANCES = "occupancy.ply", "grid.yaml", "grid.pgm", "distances.npz"
OCCUPANCY_FILES = (VOXELS, GRID, PICTURE, DISTANCES)


def write_occupancy(
    folder: Path, occupancy: OccupancyMap
) -> tuple[tuple[Path, ...], Mapping[str, Any], OccupancyGrid | None]:
    """Write them; nothing where nothing was seen.

    Returns:
        The files, figures of the flat map, and itself.

    Raises:
        OutputError: the disk is full or gone.
    """
    voxels = occupancy.occupied()
    if not len(voxels):
        return (), {"voxels": 0}, None
    grid = occupancy.flat()
    write_cloud(folder / VOXELS, voxels)
    write_map_server(folder / GRID, grid)
    write_distance_field(folder / DISTANCES, grid)
    figures = {
        "voxels": len(voxels),
        "cells": int(grid.cells.size),
        "free": int(np.count_nonzero(grid.cells == FREE)),
        "occupied": int(np.count_nonzero(grid.cells == OCCUPIED)),
        "resolution_m": grid.resolution_m,
    }
    return tuple(folder / name for name in OCCUPANCY_FILES), figures, grid
