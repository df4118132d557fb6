"""Scans of a LiDAR aligned to the map of those before, by KISS-ICP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import SequenceTime
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.scan_motion import at_one_moment
from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping.kiss_library import Kiss, point_to_point, thinned
from pseudolidar.mapping.surface_map import Surfaces
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.motion import BodyMotion

# KISS-ICP's map and ICP take one point of voxels of these sides, in voxels of the map.
MAP_VOXELS, ICP_VOXELS = 0.5, 1.5
# No turn of a LiDAR takes longer, s.
LONGEST_TURN_S = 1.0
# What a scan's points are off the surfaces of the map, one standard deviation, m; and how much
# surer sums of them seem than they are, in variance.
ROUGH_M, ALIKE = 0.05, 30.0


@dataclass(frozen=True, eq=False)
class ReadyScan:
    """A scan made ready for KISS-ICP.

    Args:
        xyz: (N, 3) float64 m, finite, within range, at one moment.
        dropped: points that were not finite.
    """

    xyz: Float64
    dropped: int


@dataclass(frozen=True, eq=False)
class ScanAlignment:
    """Where a scan fits.

    Args:
        T_odom_sensor: (4, 4).
        matched: share of its points that lie on the map, 0-1.
        information: (6, 6) of a twist on the right: what its points know of the pose.
    """

    T_odom_sensor: Float64
    matched: float
    information: Float64


def ready(
    scan: LidarScan, *, nearest_m: float, farthest_m: float, twist_per_s: Float64 | None
) -> ReadyScan:
    """A scan without points that are no points, at one moment where their times are known.

    Args:
        scan: as recorded.
        nearest_m: points nearer to the sensor are of what carries it.
        farthest_m: points farther are left out.
        twist_per_s: (6,) how the sensor moves, where that is known.

    Raises:
        SequenceTime: times of points that are not of this scan.
    """
    finite = np.asarray(np.isfinite(scan.xyz).all(axis=1))
    xyz = scan.xyz[finite].astype(np.float64)
    if scan.point_times_ns is not None and len(xyz):
        seconds = (scan.point_times_ns[finite] - scan.timestamp_ns) / NS_PER_S
        _check_times(seconds, scan)
        if twist_per_s is not None:
            motion = BodyMotion(scan.frame, twist_per_s[:3].copy(), twist_per_s[3:].copy())
            xyz = at_one_moment(xyz, seconds, motion).astype(np.float64)
    range_m = np.linalg.norm(xyz, axis=1)
    kept = (range_m > nearest_m) & (range_m < farthest_m)
    return ReadyScan(np.ascontiguousarray(xyz[kept]), int(len(finite) - finite.sum()))


def _check_times(seconds: Float64, scan: LidarScan) -> None:
    farthest = float(np.abs(seconds).max())
    if farthest > LONGEST_TURN_S:
        raise SequenceTime(
            f"a point taken {farthest:.3g} s from its scan's time",
            want=f"times of points within {LONGEST_TURN_S:g} s of {scan.timestamp_ns} ns",
            fix="Leave the points' times out, or mend their unit.",
            where="point times",
        )


class ScanMap:
    """KISS-ICP's map of scans; its steps in the order of its pipeline.

    Args:
        kiss: with its settings.
        voxel_m: side of the map's voxels.
    """

    def __init__(self, kiss: Kiss, voxel_m: float) -> None:
        self._voxel_m = voxel_m
        self._map, self._threshold = kiss.voxel_map(), kiss.threshold()
        self._registration = point_to_point()

    def align(self, scan: ReadyScan, T_guess: Float64) -> ScanAlignment:
        """The pose of a scan, near a guess."""
        coarse = thinned(self._thinned(scan), self._voxel_m * ICP_VOXELS)
        T = self._registration.align(coarse, self._map, T_guess, self._threshold.get_threshold())
        return ScanAlignment(T, *self._lying(coarse, T))

    def add(self, scan: ReadyScan, T_odom_sensor: Float64, T_guess: Float64 | None = None) -> None:
        """Add a scan where it is, and learn how far the guess was off."""
        if T_guess is not None:
            self._threshold.update_model_deviation(inverted(T_guess) @ T_odom_sensor)
        self._map.update(self._thinned(scan), T_odom_sensor)

    def _thinned(self, scan: ReadyScan) -> Float64:
        return thinned(scan.xyz, self._voxel_m * MAP_VOXELS)

    def _lying(self, xyz: Float64, T: Float64) -> tuple[float, Float64]:
        """Share of points on the map's surfaces, and what they know of the pose."""
        at = np.einsum("ij,nj->ni", T[:3, :3], xyz) + T[:3, 3]
        surfaces = Surfaces(self._map.point_cloud())
        index, found = surfaces.nearest(at, 0.5 * self._voxel_m)
        normals = surfaces.normals(index[found])
        flat = np.isfinite(normals).all(axis=1)
        seen = np.einsum("ji,nj->ni", T[:3, :3], normals[flat])
        J = np.concatenate([seen, np.cross(xyz[found][flat], seen)], axis=1)
        information = np.einsum("ni,nj->ij", J, J) / (ALIKE * ROUGH_M**2)
        return float(found.mean()) if len(found) else 0.0, information
