"""Beam patterns of spinning LiDARs: which directions they measure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float64, Int64

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


def every_nth_beam(table: BeamTable, beams: int) -> BeamTable:
    """The table with `beams` lasers, evenly taken from all of them."""
    step = len(table.elevations_deg) / beams
    chosen = tuple(table.elevations_deg[int((i + 0.5) * step)] for i in range(beams))
    return replace(table, elevations_deg=chosen)


def seen_by_beams(xyz: AnyArray, table: BeamTable) -> Int64:
    """Rows of the points that a LiDAR at the origin would have measured, increasing.

    Of the points within the footprint of a firing the nearest surface returns; of its points the
    one closest to the beam's axis is taken. A point belongs to the laser that is nearest, within
    an eighth of a degree (those of the upper block are a third apart), and to one azimuth step.

    Args:
        xyz: (N, 3) m in a frame with x forward, y left, z up.
        table: directions and range.
    """
    from pseudolidar.geometry.beam_kernels import nearest_returns

    lasers = np.radians(np.sort(np.array(table.elevations_deg)))
    keep = np.zeros(len(xyz), np.bool_)
    points = np.ascontiguousarray(xyz, np.float64)
    nearest_returns(points, lasers, len(table.azimuths_rad()), np.array(table.range_m), keep)
    return np.flatnonzero(keep)
