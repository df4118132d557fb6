"""Voxels and a flat map for robots, as settings: light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pseudolidar.mapping.occupancy_map import OccupancyMap


@dataclass(frozen=True)
class Occupancy:
    """Voxels and a flat map for robots.

    Args:
        voxel_m: side of a voxel and of a cell.
        far_m: points beyond are not held; their rays tell that the way there is free.
        above_m: what is lower above the ground is no obstacle (kerbs, grass, noise).
        below_m: what is higher is none either: one drives beneath it.
        memory_mb: memory for voxels, in megabytes.
    """

    voxel_m: float = 0.1
    far_m: float = 25.0
    above_m: float = 0.2
    below_m: float = 2.0
    memory_mb: int = 1000

    def start(self) -> OccupancyMap:
        """An empty map."""
        from pseudolidar.mapping.occupancy_map import OccupancyMap

        return OccupancyMap(self)
