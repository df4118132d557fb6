"""A flat map for robots: which cells of the ground are free, taken or unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Float32, UInt8, check_array

# Values of cells, as ROS's OccupancyGrid has them (there unknown is -1, the same byte).
FREE, OCCUPIED, UNKNOWN = 0, 100, 255


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Cells of a plane across z.

    Args:
        cells: (H, W) uint8 `FREE`, `OCCUPIED` or `UNKNOWN`; rows along y, columns along x.
        resolution_m: side of a cell.
        origin_m: x, y of the outer corner of cell [0, 0], where x and y are least.
        frame: coordinate frame.
    """

    cells: UInt8
    resolution_m: float
    origin_m: tuple[float, float]
    frame: str

    def __post_init__(self) -> None:
        check_array("OccupancyGrid", "cells", self.cells, (None, None), np.uint8)
        if not np.isin(self.cells, (FREE, OCCUPIED, UNKNOWN)).all():
            raise StructureError(
                "other values", want=f"{FREE}, {OCCUPIED}, {UNKNOWN}", where="OccupancyGrid.cells"
            )
        if not self.resolution_m > 0:
            raise StructureError(
                f"{self.resolution_m} m", want="> 0", where="OccupancyGrid.resolution_m"
            )

    def distance_m(self) -> Float32:
        """(H, W) from each cell's centre to that of the nearest occupied one.

        NaN in unknown cells, inf everywhere known where nothing is occupied.
        """
        from scipy.ndimage import distance_transform_edt

        taken = self.cells == OCCUPIED
        if taken.any():
            far = distance_transform_edt(~taken).astype(np.float32) * np.float32(self.resolution_m)
        else:
            far = np.full(taken.shape, np.inf, np.float32)
        far[self.cells == UNKNOWN] = np.nan
        return np.asarray(far)
