"""Which laser of a spinning LiDAR measured each point, and scans as sensors with fewer see them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from pseudolidar.geometry.beams import hdl64
from pseudolidar.structures.arrays import AnyArray, Bool, Int64
from pseudolidar.structures.frame import LidarScan

# `even`: every so-manieth laser from top to bottom; `level`: those around the horizon.
BeamPattern = Literal["even", "level"]
# Beams of a level sensor are so far apart, degrees (Valeo ScaLa, the sensor that You et al.,
# Pseudo-LiDAR++, ICLR 2020, simulate with 4 beams of an HDL-64E).
LEVEL_STEP_DEG = 0.8
# Files that are written laser by laser hold so many turns.
LASERS = range(4, 257)
# A turn begins where the azimuth falls by so much, radians.
NEXT_TURN_RAD = np.pi


def lasers_of(xyz: AnyArray) -> Int64:
    """(N,) number of the laser that measured each point, 0 for the highest.

    KITTI's files hold one laser's turn after the other, from the highest to the lowest, each from
    straight ahead to the left all the way round (a test looks at 33 scans: 64 turns each, median
    elevations falling from between +2.2 and +2.8 degrees to between -23.5 and -23.7). Where points
    are in another order, the nearest elevation of an HDL-64E decides; that mixes neighbouring
    lasers near the sensor, as they sit up to 10 cm above or below its origin.

    Args:
        xyz: (N, 3) m in the LiDAR's frame, x forward, y left, z up, in the order of the file.
    """
    azimuth = np.arctan2(xyz[:, 1].astype(np.float64), xyz[:, 0]) % (2 * np.pi)
    elevation = np.degrees(np.arctan2(xyz[:, 2].astype(np.float64), np.hypot(xyz[:, 0], xyz[:, 1])))
    turn = np.zeros(len(xyz), np.int64)
    turn[1:] = np.cumsum(np.diff(azimuth) < -NEXT_TURN_RAD)
    if _is_laser_by_laser(turn, elevation):
        return turn
    table = np.sort(hdl64().elevations_deg)
    between = (table[1:] + table[:-1]) / 2
    return np.asarray(len(table) - 1 - np.searchsorted(between, elevation), np.int64)


def scan_of_beams(scan: LidarScan, beams: int, *, pattern: BeamPattern = "even") -> LidarScan:
    """What a sensor with fewer beams would have measured: the points of some lasers.

    Args:
        scan: in the LiDAR's own frame.
        beams: lasers that are kept; all of them where the scan has no more.
        pattern: which.
    """
    used = of_beams(scan.xyz, beams, pattern=pattern)
    return scan if used.all() else _subset(scan, used)


def of_beams(xyz: AnyArray, beams: int, *, pattern: BeamPattern = "even") -> Bool:
    """(N,) points that some lasers measured.

    Args:
        xyz: (N, 3) m in the LiDAR's frame, in the order of the file.
        beams: lasers that are kept; all of them where there are no more.
        pattern: which.
    """
    laser = lasers_of(xyz)
    count = int(laser.max()) + 1 if len(xyz) else 0
    if beams >= count:
        return np.ones(len(xyz), np.bool_)
    if pattern == "even":
        chosen = ((np.arange(beams) + 0.5) * count / beams).astype(np.int64)
    else:
        chosen = _level_lasers(xyz, laser, beams)
    return np.isin(laser, chosen)


def _is_laser_by_laser(turn: Int64, elevation_deg: AnyArray) -> bool:
    count = int(turn[-1]) + 1 if len(turn) else 0
    if count not in LASERS:
        return False
    medians = _medians(turn, elevation_deg, count)
    return bool((np.diff(medians) < 0).all())


def _medians(group: Int64, values: AnyArray, count: int) -> AnyArray:
    """(count,) median of the values of each group; NaN for those without any."""
    order = np.argsort(group, kind="stable")
    parts = np.split(values[order], np.searchsorted(group[order], np.arange(1, count)))
    return np.array([np.median(part) if len(part) else np.nan for part in parts])


def _level_lasers(xyz: AnyArray, laser: Int64, beams: int) -> Int64:
    """Lasers nearest to `beams` elevations about `LEVEL_STEP_DEG` apart, the highest at 0."""
    elevation = np.degrees(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    medians = _medians(laser, elevation, int(laser.max()) + 1)
    wanted = -LEVEL_STEP_DEG * np.arange(beams)
    return np.asarray(np.nanargmin(np.abs(medians - wanted[:, None]), axis=1), np.int64)


def _subset(scan: LidarScan, keep: Bool) -> LidarScan:
    rows = np.flatnonzero(keep)

    def of(column: AnyArray | None) -> AnyArray | None:
        return None if column is None else column[rows]

    return replace(
        scan,
        xyz=scan.xyz[rows],
        reflectance=of(scan.reflectance),
        point_times_ns=of(scan.point_times_ns),
    )
