"""The flat map in the report of a map."""

from __future__ import annotations

import numpy as np

from pseudolidar.running.mapped.walked import Piece, Placed
from pseudolidar.running.reports import map_grid
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


def test_a_large_grid_loses_no_obstacle():
    cells = np.full((7, 10), UNKNOWN, np.uint8)
    cells[:, 2:] = FREE
    cells[6, 9] = OCCUPIED
    worst = map_grid._worst(cells, 4)
    assert worst.tolist() == [[FREE, FREE, FREE], [FREE, FREE, OCCUPIED]]
    picture = map_grid.cells_picture(worst)
    assert picture[1, 2].tolist() == [0, 0, 0]
    assert picture[0, 0].tolist() == [254, 254, 254]
    grid = OccupancyGrid(cells, 0.5, (0.0, 0.0), "map")
    least = map_grid._least(grid.distance_m(), 4)
    assert least[1, 2] == 0.0
    assert least[0, 0] == np.float32(np.hypot(3, 6) * 0.5)
    nothing = np.full((2, 2), UNKNOWN, np.uint8)
    assert np.isnan(
        map_grid._least(OccupancyGrid(nothing, 0.5, (0, 0), "map").distance_m(), 1)
    ).all()


def test_the_section_names_its_cells():
    rig = Synthetic("street", width_px=64, height_px=32).open().rig
    frames = tuple(Placed(f"{i}", i, i, "ok", "", 0, 0, 0, False, None) for i in range(2))
    piece = Piece(frames, np.stack([np.eye(4)] * 2), np.zeros((2, 6, 6)))
    grid = OccupancyGrid(np.full((4, 6), FREE, np.uint8), 0.25, (-1.0, 2.0), "map")
    (section,) = map_grid.grid_sections(grid, [piece], rig)
    assert "cells of 0.25 m" in section.pictures[0].pictures[0].caption
    assert map_grid.grid_sections(None, [piece], rig) == []
