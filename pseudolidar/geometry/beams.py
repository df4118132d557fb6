"""Beam patterns of spinning LiDARs: which directions they measure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64

# Upper and lower laser block of the HDL-64E: 32 lasers each, elevation of first and last, degrees.
# Source: Velodyne HDL-64E S2 manual (vertical field +2 to -24.8 deg, 1/3 and 1/2 deg spacing) and
# its published calibrations: +2 to -8.33 and -8.87 to -24.33.
HDL64_BLOCKS_DEG = ((2.0, -8.33), (-8.87, -24.33))
HDL64_LASERS_A_BLOCK = 32
# Azimuth between firings at 10 turns a second, degrees (manual: 0.1728 at 600 rpm).
HDL64_AZIMUTH_STEP_DEG = 0.1728
# It measures between these ranges, metres.
HDL64_RANGE_M = (0.9, 120.0)


@dataclass(frozen=True)
class BeamTable:
    """Where a spinning LiDAR looks in one turn.

    Args:
        elevations_deg: of each laser, highest first.
        azimuth_step_deg: between firings.
        range_m: nearest and farthest range it measures.
    """

    elevations_deg: tuple[float, ...]
    azimuth_step_deg: float
    range_m: tuple[float, float]

    def azimuths_rad(self) -> Float64:
        """(A,) from straight ahead turning left, all the way round."""
        count = round(360.0 / self.azimuth_step_deg)
        return np.arange(count, dtype=np.float64) * (2 * np.pi / count)

    def directions(self) -> Float64:
        """(L * A, 3) unit vectors in `velodyne` (x forward, y left, z up), laser by laser."""
        elevation = np.deg2rad(self.elevations_deg)[:, None]
        azimuth = self.azimuths_rad()[None, :]
        x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
        z = np.broadcast_to(np.sin(elevation), x.shape)
        return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def hdl64(azimuth_step_deg: float = HDL64_AZIMUTH_STEP_DEG) -> BeamTable:
    """The Velodyne HDL-64E of KITTI, or one with coarser azimuth steps."""
    blocks = [np.linspace(*ends, HDL64_LASERS_A_BLOCK) for ends in HDL64_BLOCKS_DEG]
    elevations = tuple(float(e) for e in np.concatenate(blocks))
    return BeamTable(elevations, azimuth_step_deg, HDL64_RANGE_M)
