"""Voxels and a flat map for robots, as settings: light to import."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pseudolidar.errors import UsageError

if TYPE_CHECKING:
    from pseudolidar.mapping.occupancy_map import OccupancyMap


# Sides that people write, as 0.3 on 0.1, are whole numbers to rounding.
WHOLE = 1e-6


@dataclass(frozen=True)
class Occupancy:
    """Voxels and a flat map for robots.

    Args:
        voxel_m: side of a voxel.
        cell_m: side of a cell of the flat map and of the distances, some whole number of voxels; by
            default one voxel.
        far_m: points beyond are not held; their rays tell that the way there is free.
        above_m: what is lower above the ground is no obstacle (kerbs, grass, noise).
        below_m: what is higher is none either: one drives beneath it.
        memory_mb: memory for voxels, in megabytes.
    """

    voxel_m: float = 0.1
    cell_m: float | None = None
    far_m: float = 25.0
    above_m: float = 0.2
    below_m: float = 2.0
    memory_mb: int = 1000

    def __post_init__(self) -> None:
        if not self.voxel_m > 0:
            raise UsageError(f"voxels of {self.voxel_m:g} m", want="more than 0")
        voxels = self._cell_m / self.voxel_m
        whole = math.isfinite(voxels) and voxels > 0 and round(voxels) > 0
        if not (whole and abs(voxels - round(voxels)) < WHOLE * voxels):
            side_m = self.voxel_m
            raise UsageError(
                f"cells of {self._cell_m:g} m on voxels of {side_m:g} m",
                want="a whole number of voxels",
                fix=f"Take {side_m:g}, {2 * side_m:g}, {3 * side_m:g} and so on.",
                where="cell-m",
            )

    @property
    def _cell_m(self) -> float:
        return self.voxel_m if self.cell_m is None else self.cell_m

    @property
    def voxels_a_cell(self) -> int:
        """Along its side."""
        return round(self._cell_m / self.voxel_m)

    def start(self) -> OccupancyMap:
        """An empty map."""
        from pseudolidar.mapping.occupancy_map import OccupancyMap

        return OccupancyMap(self)
