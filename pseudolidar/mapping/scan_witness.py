"""Scans of a LiDAR as a witness of vision's steps: their planes laid on the map of those before.

KISS-ICP's own point to point ICP holds on to the rings of the scan before where steps are short
against its voxels; small planes slide along themselves, and vision holds what they leave open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.pose_doubt import unsure_m
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.mapping.alignment import Alignment, Prior, align, lying_at
from pseudolidar.mapping.kiss_library import load_kiss, thinned
from pseudolidar.mapping.patches import Patches
from pseudolidar.mapping.scan_map import ReadyScan, ready
from pseudolidar.mapping.surface_map import SurfaceMap, Surfaces
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.pose import Pose

# Side of the map's voxels and its reach, m; scans are thinned to half a voxel, and of so many
# points the planes are looked at.
VOXEL_M, FARTHEST_M, MOST_PLANES = 0.5, 60.0, 2500
# Nearer points are of what carries the sensor, m.
NEAREST_M = 1.0
# One standard deviation of a range, m, and how far steps of vision are off at first.
SIGMA_M, FIRST_THRESHOLD_M = 0.02, 0.15
# Without vision: how far a pose may be from where the sensor would go on to, one standard
# deviation, m and rad; the share of a scan that must lie on the map; and how unsure its planes may
# leave a place, m, with what little is known of directions in which they slide.
GUESSED_M, GUESSED_RAD, LEAST_ALONE, MOST_UNSURE_M, SLIDING = 0.3, 0.03, 0.5, 0.1, 1e-2
# Where a scan is looked for ahead of the one before where no motion is known yet, m along the
# optical axis (40 m/s at 10 a second), with every so many of its planes.
SEARCHED_M, SEARCH_EVERY = np.arange(-0.8, 4.01, 0.4), 4
# Planes are matched within so many thresholds. A scan says something if it has so many planes, and
# so large a share of them lies on the map.
WITHIN_THRESHOLDS, LEAST_PLANES, LEAST_MATCHED = 3.0, 100, 0.3


@dataclass(frozen=True, eq=False)
class ScanPlanes:
    """A scan in the left camera's frame.

    Args:
        xyz: (N, 3) float64 m, thinned.
        planes: small surfaces at some of its points.
    """

    xyz: Float64
    planes: Patches

    @classmethod
    def of(cls, points: ReadyScan, T_left_lidar: Pose) -> ScanPlanes | None:
        """None where there are too few planes to say anything."""
        xyz = T_left_lidar.apply(thinned(points.xyz, VOXEL_M / 2))
        if len(xyz) < LEAST_PLANES:
            return None
        some = np.arange(0, len(xyz), max(1, len(xyz) // MOST_PLANES))
        normals = Surfaces(xyz).normals(some)
        flat = np.isfinite(normals).all(axis=1)
        planes = Patches(xyz[some[flat]], normals[flat], np.full(int(flat.sum()), SIGMA_M))
        return cls(xyz, planes) if len(planes) >= LEAST_PLANES else None


def scan_points(scan: LidarScan) -> ReadyScan:
    """The points of a scan that planes are looked for in.

    Raises:
        SequenceTime: times of points that are not of this scan.
    """
    return ready(scan, nearest_m=NEAREST_M, farthest_m=FARTHEST_M, twist_per_s=None)


class ScanWitness:
    """The map of scans so far, from where a piece of path begins.

    Raises:
        MissingDependency: kiss-icp is absent.
    """

    def __init__(self) -> None:
        kiss = load_kiss(voxel_m=VOXEL_M, farthest_m=FARTHEST_M, threshold_m=FIRST_THRESHOLD_M)
        self._map, self._threshold = SurfaceMap(kiss), kiss.threshold()

    @property
    def empty(self) -> bool:
        """Whether there is nothing yet to lay a scan on."""
        return self._map.empty

    def align(self, scan: ScanPlanes, prior: Prior) -> Alignment | None:
        """The pose that scan and prior agree on; None where the scan does not lie on the map."""
        if self._map.empty:
            return None
        within_m = WITHIN_THRESHOLDS * self._threshold.get_threshold()
        found = align(scan.planes, self._map.surfaces(), prior, within_m=within_m)
        return found if found.matched >= LEAST_MATCHED else None

    def alone(self, scan: ScanPlanes, T_guess: Float64) -> Alignment | None:
        """The pose of a scan near a guess (4, 4), where nothing else is known of it.

        None where it does not lie on the map, or could slide along it.
        """
        prior = Prior.within(T_guess, metres=GUESSED_M, rad=GUESSED_RAD)
        found = self.align(scan, prior)
        if found is None or found.matched < LEAST_ALONE:
            return None
        held = np.asarray(np.linalg.inv(found.from_map + SLIDING * np.eye(6)))
        return found if unsure_m(held) <= MOST_UNSURE_M else None

    def ahead(self, scan: ScanPlanes, T_odom_camera: Float64) -> Float64:
        """(4, 4) where a scan lies best, roughly, on the line ahead of a place (4, 4).

        For the first step of a path, before any motion is known; turns are not tried.
        """
        surfaces, some = self._map.surfaces(), scan.planes[::SEARCH_EVERY]
        within_m = WITHIN_THRESHOLDS * self._threshold.get_threshold()
        places = [T_odom_camera @ exp_twist(np.array([0, 0, z, 0, 0, 0])) for z in SEARCHED_M]
        scores = [
            lying_at(some, surfaces, Prior(T, np.eye(6)), within_m=within_m).score for T in places
        ]
        return places[int(np.argmax(scores))]

    def remember(self, scan: ScanPlanes, T_odom_camera: Float64) -> None:
        """Add a scan where it is."""
        self._map.add(scan.xyz, T_odom_camera)
