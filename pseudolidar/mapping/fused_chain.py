"""Vision's steps, checked by other witnesses and laid on a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.twists import gone_on, inverted, log_twist
from pseudolidar.mapping.alignment import Alignment, Prior, align, lying_at
from pseudolidar.mapping.fused_path import FusedPath, FusedStep, Place, step_between
from pseudolidar.mapping.fused_sight import Anchor, FusedSight
from pseudolidar.mapping.integrity import StepCheck, checked, step_check
from pseudolidar.mapping.kiss_library import load_kiss
from pseudolidar.mapping.registered import Registered
from pseudolidar.mapping.scan_counts import ScanCounts
from pseudolidar.mapping.scan_overrule import lying_elsewhere
from pseudolidar.mapping.scan_witness import ScanPlanes, ScanWitness, scan_points
from pseudolidar.mapping.second_look import SecondLook
from pseudolidar.mapping.seeing import Seeing
from pseudolidar.mapping.surface_map import SurfaceMap, Surfaces
from pseudolidar.mapping.vision_prior import agreed_step, prior_by
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose, Trajectory

# A map of stereo patches: side of its voxels, reach, and how far predictions are off at first, m.
VOXEL_M, REACH_M, FIRST_THRESHOLD_M = 0.4, 40.0, 0.15
# Patches are matched within so many of KISS-ICP's thresholds.
WITHIN_THRESHOLDS = 3.0


class FusedChain:
    """Vision's steps, checked and laid on maps of patches and of scans, in order.

    What vision loses is laid on the map of scans alone; what scans do not show is vision's.

    Args:
        visual: begun.
        rig: rectified.
        reach: frames in a row that both may lose; with one more the piece of path has ended.
    """

    def __init__(self, visual: Seeing, rig: StereoRig, *, reach: int) -> None:
        self._visual, self._rig, self._reach = visual, rig, reach
        self._kiss = load_kiss(voxel_m=VOXEL_M, farthest_m=REACH_M, threshold_m=FIRST_THRESHOLD_M)
        self._pieces: list[FusedPath] = []
        self._anchor: Anchor | None = None
        self._twist_per_s: Float64 | None = None
        self._lost = 0
        self.scan_counts = ScanCounts()

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now."""
        return self._visual.correction

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses with all that is known by now, and covariances, piece by piece."""
        by_vision, offset = self._visual.trajectories(), self._visual.offset
        return tuple(piece.settled(by_vision, offset) for piece in self._pieces)

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> Registered:
        """Where the next frame was taken.

        Args:
            frame: of the same rig as all, later than the one before.
            disparity: of its left image, as matched.
            movable: things in its left image that may move by themselves.

        Raises:
            SequenceTime: the frame is not later than the one before.
        """
        state, scan = self._visual.register(frame, disparity, movable), self._counted_scan(frame)
        if not state.measured:
            return self._by_scan(state, frame.timestamp_ns, scan) or self._lose(state)
        rig = self._rig.with_correction(self._visual.correction)
        seen = FusedSight.of(frame, disparity, rig, scan)
        if state.step is None or self._anchor is None:
            return self._anew(state, seen)
        return self._go_on(state, state.step, seen, self._anchor)

    @property
    def _path(self) -> FusedPath:
        return self._pieces[-1]

    def _counted_scan(self, frame: StereoFrame) -> ScanPlanes | None:
        """The planes of a frame's scan, and what is odd about it counted."""
        T_left_lidar = self._rig.T_left_velodyne
        if frame.scan is None or T_left_lidar is None:
            return None
        points, counts = scan_points(frame.scan), self.scan_counts
        planes = ScanPlanes.of(points, T_left_lidar)
        counts.scans += 1
        counts.dropped_points += points.dropped + frame.scan.dropped
        counts.empty += not len(points.xyz)
        counts.few += planes is None and len(points.xyz) > 0
        return planes

    def _anew(self, state: OdometryState, seen: FusedSight) -> Registered:
        """Vision begins a piece: the path goes on if the scan says where, or begins as well."""
        told = self._by_scan(state, seen.timestamp_ns, seen.scan)
        if told is None:
            told = self._begin(state, seen)
        self._map.add(seen.mapped_xyz, self._path.last.T_odom_camera)
        self._anchor = Anchor(seen, self._path.last, state.piece, 0)
        return told

    def _begin(self, state: OdometryState, seen: FusedSight) -> Registered:
        self._pieces.append(FusedPath(seen.timestamp_ns))
        self._map, self._threshold = SurfaceMap(self._kiss), self._kiss.threshold()
        self._twist_per_s, self._scans, self._lost = None, ScanWitness(), 0
        if seen.scan:
            self._scans.remember(seen.scan, np.eye(4))
        return Registered(replace(state, piece=len(self._pieces) - 1), sensors="vision")

    def _lose(self, state: OdometryState) -> Registered:
        self._lost += 1
        return Registered(replace(state, piece=max(0, len(self._pieces) - 1)))

    def _by_scan(
        self, state: OdometryState, timestamp_ns: int, scan: ScanPlanes | None
    ) -> Registered | None:
        """The frame where its scan lies on the map; None where that does not say enough."""
        twist = self._twist_per_s
        if scan is None or twist is None or self._lost > self._reach:
            return None
        found = self._scans.alone(scan, self._gone_on(timestamp_ns, twist))
        if found is None:
            self.scan_counts.unplaced += not self._scans.empty
            return None
        return self._laid(state, timestamp_ns, scan, found)

    def _gone_on(self, timestamp_ns: int, twist_per_s: Float64) -> Float64:
        """(4, 4) where the sensors would go on to."""
        last = self._path.last
        seconds = (timestamp_ns - last.timestamp_ns) / NS_PER_S
        return gone_on(last.T_odom_camera, twist_per_s, seconds)

    def _laid(
        self, state: OdometryState, timestamp_ns: int, scan: ScanPlanes, found: Alignment
    ) -> Registered:
        """The frame where its scan was found to lie."""
        last = self._path.last
        T_from_to = inverted(last.T_odom_camera) @ found.T_odom_sensor
        covariance = np.asarray(np.linalg.inv(found.information))
        step = FusedStep(T_from_to, covariance, np.zeros(6))
        self._scans.remember(scan, found.T_odom_sensor)
        told = self._told(state, step, last, last, self._path.add(timestamp_ns, step))
        return Registered(told, alignment=found, sensors="scan")

    def _go_on(
        self, state: OdometryState, step: CameraStep, seen: FusedSight, anchor: Anchor
    ) -> Registered:
        """By vision's step from the frame that it placed last, which scans may have gone beyond."""
        surfaces = self._map.surfaces()
        within_m = WITHIN_THRESHOLDS * float(self._threshold.get_threshold())
        check = self._checked(step, seen, anchor, surfaces, within_m)
        offset_sigma_px = self._visual.offset.sigma_px if seen.scan else 0.0
        prior = prior_by(step, check, anchor, offset_sigma_px=offset_sigma_px)
        by_scan = self._scans.align(seen.scan, prior) if seen.scan else None
        overruled = self._overruled(state, check, seen, anchor, by_scan)
        if overruled is not None:
            return overruled
        unplaced = seen.scan is not None and by_scan is None and not self._scans.empty
        self.scan_counts.unplaced += unplaced
        found = by_scan or align(seen.some, surfaces, prior, within_m=within_m)
        self._threshold.update_model_deviation(inverted(prior.T_odom_sensor) @ found.T_odom_sensor)
        if check.wrong:
            doubt = np.asarray(np.linalg.inv(prior.information))
            step = replace(step, covariance=doubt, by_offset=np.zeros(6))
        # A scan has put right by then what vision learns later of the rig.
        follows = float(not check.wrong and by_scan is None)
        fused = agreed_step(anchor, step, prior, found, follows=follows)
        last = self._path.last
        now = self._path.add(seen.timestamp_ns, fused, anchor.place)
        told = self._told(state, fused, anchor.place, last, now)
        if seen.scan:
            self._scans.remember(seen.scan, found.T_odom_sensor)
        self._go_on_from(seen, anchor)
        return Registered(told, check, found, "vision" if by_scan is None else "vision and scan")

    def _overruled(
        self,
        state: OdometryState,
        check: StepCheck,
        seen: FusedSight,
        anchor: Anchor,
        by_scan: Alignment | None,
    ) -> Registered | None:
        """The frame where its scan lies, if that is elsewhere than by vision's step."""
        if seen.scan is None:
            return None
        T_from, twist = anchor.place.T_odom_camera, self._twist_per_s
        T_guess = None if twist is None else self._gone_on(seen.timestamp_ns, twist)
        other = lying_elsewhere(
            self._scans, seen.scan, check.T_from_to, by_scan, T_from=T_from, T_guess=T_guess
        )
        if other is None:
            return None
        agrees = 0.0 if by_scan is None else by_scan.score
        T_other = inverted(T_from) @ other.T_odom_sensor
        said = step_check("scans", True, check.T_from_to, T_other, agrees, other.score)
        told = self._laid(state, seen.timestamp_ns, seen.scan, other)
        self._go_on_from(seen, anchor)
        return replace(told, check=said)

    def _go_on_from(self, seen: FusedSight, anchor: Anchor) -> None:
        """Remember a frame that was placed, which vision's next step begins at."""
        self._map.add(seen.mapped_xyz, self._path.last.T_odom_camera)
        self._anchor = Anchor(seen, self._path.last, anchor.piece, anchor.frame + 1)

    def _checked(
        self,
        step: CameraStep,
        seen: FusedSight,
        anchor: Anchor,
        surfaces: Surfaces,
        within_m: float,
    ) -> StepCheck:
        T_odom, last, twist = anchor.place.T_odom_camera, self._path.last, self._twist_per_s
        seconds = (seen.timestamp_ns - last.timestamp_ns) / NS_PER_S

        def map_score(T_from_to: Float64) -> float:
            at = Prior(T_odom @ T_from_to, np.eye(6))
            return lying_at(seen.some, surfaces, at, within_m=within_m).score

        return checked(
            step.T_from_to,
            None if twist is None else gone_on(anchor.place.to(last), twist, seconds),
            SecondLook(anchor.seen.grey, seen.grey, seen.patches, self._rig),
            map_score,
        )

    def _told(
        self, state: OdometryState, step: FusedStep, start: Place, last: Place, now: Place
    ) -> OdometryState:
        """Vision's state with the pose, the step and the doubts that are right in the end."""
        T_from_to, doubt = step_between(last, start, now, step)
        self._twist_per_s = log_twist(T_from_to) / (
            (now.timestamp_ns - last.timestamp_ns) / NS_PER_S
        )
        frames, self._lost = self._lost + 1, 0
        return replace(
            state,
            status="ok",
            T_odom_camera=Pose(ODOM, self._rig.left.frame, now.T_odom_camera),
            step=CameraStep(T_from_to, doubt, frames=frames, by_offset=step.by_offset),
            covariance=now.doubt.total(self._visual.offset),
            piece=len(self._pieces) - 1,
        )
