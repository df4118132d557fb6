"""Where a LiDAR was, scan by scan: KISS-ICP with its input checked and its failures told."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.twists import carried, exp_twist, inverted, log_twist
from pseudolidar.mapping.kiss_library import load_kiss
from pseudolidar.mapping.scan_counts import ScanCounts
from pseudolidar.mapping.scan_map import ReadyScan, ScanAlignment, ScanMap, ready
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose

# How far predictions are off at first, m: KISS-ICP's own.
FIRST_THRESHOLD_M = 2.0
# A direction that scans know less of than this holds no pose: information, 1 / m2 and 1 / rad2.
HOLD = 1e-2


@dataclass(frozen=True)
class ScanOdometry:
    """KISS-ICP on the scans of a LiDAR.

    Args:
        voxel_m: side of the map's voxels.
        nearest_m: points nearer than this are of the vehicle.
        farthest_m: points farther than this are left out.
        least_points: a scan with fewer points cannot be placed.
        least_matched: share of a scan that must lie on the map.
        reach: scans that may be lost in a row; afterwards a new piece of path begins.
    """

    voxel_m: float = 1.0
    nearest_m: float = 0.0
    farthest_m: float = 100.0
    least_points: int = 200
    least_matched: float = 0.5
    reach: int = 5

    def __post_init__(self) -> None:
        fine = 0 < self.voxel_m < self.farthest_m and 0 <= self.nearest_m < self.farthest_m
        fine &= self.least_points >= 6 and 0 < self.least_matched <= 1 and self.reach >= 1
        if not fine:
            raise UsageError(
                f"voxels of {self.voxel_m:g} m, points at {self.nearest_m:g}-{self.farthest_m:g} "
                f"m, at least {self.least_points} points and {self.least_matched:g} of a scan, "
                f"reach {self.reach}",
                want="sizes over 0, nearest below farthest, 6 points, a share of 0-1, reach 1",
            )

    def start(self) -> ScanChain:
        """Begin with the first scan to come.

        Raises:
            MissingDependency: kiss-icp is absent.
        """
        return ScanChain(self)


@dataclass(frozen=True, eq=False)
class _At:
    """The last scan that was placed."""

    T_odom_sensor: Float64
    timestamp_ns: int
    covariance: Float64
    twist_per_s: Float64 = field(default_factory=lambda: np.zeros(6))
    moved: bool = False


class ScanChain:
    """Scans chained, in order.

    Args:
        settings: as declared.
    """

    def __init__(self, settings: ScanOdometry) -> None:
        self._settings = settings
        self._kiss = load_kiss(
            voxel_m=settings.voxel_m,
            farthest_m=settings.farthest_m,
            threshold_m=FIRST_THRESHOLD_M,
        )
        self.counts = ScanCounts()
        self._map = ScanMap(self._kiss, settings.voxel_m)
        self._last: _At | None = None
        self._piece, self._lost = 0, 0

    def register(
        self, scan: LidarScan, timestamp_ns: int, T_step: Float64 | None = None
    ) -> OdometryState:
        """Where the next scan was taken.

        Poses are of the scan's own frame; `odom` is that of the piece's first scan.

        Args:
            scan: as recorded; points with times of their own are moved to the scan's time.
            timestamp_ns: later than that of the scan before.
            T_step: (4, 4) `T_from_to` since the last scan that was placed, where somebody knows;
                a constant velocity otherwise.

        Raises:
            SequenceTime: times of points that are not of this scan.
        """
        last = self._last
        twist = last.twist_per_s if last is not None and last.moved else None
        points = self._ready(scan, twist)
        why = self._unusable(points)
        if why:
            return self._lose(why)
        if last is None:
            return self._begin(scan.frame, points, timestamp_ns)
        seconds = (timestamp_ns - last.timestamp_ns) / NS_PER_S
        step = exp_twist(seconds * last.twist_per_s) if T_step is None else T_step
        guess = last.T_odom_sensor @ step
        found = self._map.align(points, guess)
        if found.matched < self._settings.least_matched:
            self.counts.unplaced += 1
            return self._lose(
                f"{found.matched:.0%} of the scan lie on the map, "
                f"{self._settings.least_matched:.0%} are needed"
            )
        self._map.add(points, found.T_odom_sensor, guess)
        return self._go_on(scan.frame, found, last, timestamp_ns)

    def _ready(self, scan: LidarScan, twist_per_s: Float64 | None) -> ReadyScan:
        settings = self._settings
        points = ready(
            scan,
            nearest_m=settings.nearest_m,
            farthest_m=settings.farthest_m,
            twist_per_s=twist_per_s,
        )
        self.counts.scans += 1
        self.counts.dropped_points += points.dropped + scan.dropped
        self.counts.deskewed += scan.point_times_ns is not None and twist_per_s is not None
        return points

    def _unusable(self, points: ReadyScan) -> str:
        if not len(points.xyz):
            self.counts.empty += 1
            return "the scan has no usable point"
        if len(points.xyz) < self._settings.least_points:
            self.counts.few += 1
            return f"{len(points.xyz)} points, {self._settings.least_points} are needed"
        return ""

    def _begin(self, frame: str, points: ReadyScan, timestamp_ns: int) -> OdometryState:
        self._map.add(points, np.eye(4))
        self._last, self._lost = _At(np.eye(4), timestamp_ns, np.zeros((6, 6))), 0
        return OdometryState(
            "first", Pose.identity(ODOM, frame), covariance=np.zeros((6, 6)), piece=self._piece
        )

    def _lose(self, why: str) -> OdometryState:
        self._lost += 1
        if self._last is not None and self._lost > self._settings.reach:
            self._last, self._piece = None, self._piece + 1
            self._map = ScanMap(self._kiss, self._settings.voxel_m)
        return OdometryState("lost", piece=self._piece, why=why)

    def _go_on(
        self, frame: str, found: ScanAlignment, last: _At, timestamp_ns: int
    ) -> OdometryState:
        T_from_to = inverted(last.T_odom_sensor) @ found.T_odom_sensor
        covariance = np.asarray(np.linalg.inv(found.information + HOLD * np.eye(6)))
        step = CameraStep(T_from_to, covariance, frames=self._lost + 1)
        total = carried(last.covariance, T_from_to) + covariance
        seconds = (timestamp_ns - last.timestamp_ns) / NS_PER_S
        twist = log_twist(T_from_to) / seconds
        self._last = _At(found.T_odom_sensor, timestamp_ns, total, twist, moved=True)
        self._lost = 0
        return OdometryState(
            "ok",
            Pose(ODOM, frame, found.T_odom_sensor),
            step=step,
            covariance=total,
            piece=self._piece,
        )
