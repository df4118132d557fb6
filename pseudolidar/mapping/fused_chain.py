"""Vision's steps, checked by other witnesses and laid on a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.alignment import Alignment, Prior, align, lying_at
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.mapping.fused_path import FusedPath, FusedStep
from pseudolidar.mapping.integrity import StepCheck, checked
from pseudolidar.mapping.kiss_library import load_kiss
from pseudolidar.mapping.patches import Patches, find_patches
from pseudolidar.mapping.registered import Registered
from pseudolidar.mapping.scan_witness import ScanPlanes, ScanWitness
from pseudolidar.mapping.second_look import SecondLook
from pseudolidar.mapping.surface_map import SurfaceMap, Surfaces
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose, Trajectory

# A map of stereo patches: side of its voxels, reach, depth of what enters it, and how far
# predictions are off at first, m.
VOXEL_M, REACH_M, MAPPED_M, FIRST_THRESHOLD_M = 0.4, 40.0, 25.0, 0.15
# Patches are matched within so many of KISS-ICP's thresholds.
WITHIN_THRESHOLDS = 3.0
# So many patches of a frame say what all of them say.
MOST_PATCHES = 1500
# How well a step is known that took a wrong one's place, one standard deviation, m and rad.
REPLACED_M, REPLACED_RAD = 0.02, 0.002


class Seeing(Protocol):
    """What tells steps by pictures, as `VisualChain` does."""

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now."""
        ...

    @property
    def offset(self) -> Offset:
        """What is known of the rig's disparity offset by now."""
        ...

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> OdometryState:
        """Where the next frame was taken."""
        ...

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses with all that is known by now, piece by piece."""
        ...


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a frame shows, made ready."""

    timestamp_ns: int
    grey: UInt8
    patches: Patches
    some: Patches
    scan: ScanPlanes | None


class FusedChain:
    """Vision's steps, checked and laid on maps of patches and of scans, in order.

    Args:
        visual: begun.
        rig: rectified.
    """

    def __init__(self, visual: Seeing, rig: StereoRig) -> None:
        self._visual, self._rig = visual, rig
        self._kiss = load_kiss(voxel_m=VOXEL_M, farthest_m=REACH_M, threshold_m=FIRST_THRESHOLD_M)
        self._pieces: list[FusedPath] = []
        self._last: _Seen | None = None
        self._twist_per_s: Float64 | None = None

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now."""
        return self._visual.correction

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses with all that is known by now, and covariances, piece by piece."""
        by_vision, offset = self._visual.trajectories(), self._visual.offset
        return tuple(
            piece.settled(vision, offset)
            for piece, vision in zip(self._pieces, by_vision, strict=True)
        )

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
        state = self._visual.register(frame, disparity, movable)
        if state.status == "lost":
            return Registered(state)
        patches = find_patches(disparity, self._rig.with_correction(self._visual.correction))
        some = patches[:: max(1, len(patches) // MOST_PATCHES)]
        grey = grey8_pair(frame.left, frame.right)[0]
        seen = _Seen(frame.timestamp_ns, grey, patches, some, self._scan_of(frame))
        if state.step is None or self._last is None:
            told = self._begin(state, seen)
        else:
            told = self._go_on(state, state.step, seen, self._last)
        self._last = seen
        return told

    def _scan_of(self, frame: StereoFrame) -> ScanPlanes | None:
        T_left_lidar = self._rig.T_left_velodyne
        if frame.scan is None or T_left_lidar is None:
            return None
        return ScanPlanes.of(frame.scan, T_left_lidar)

    def _begin(self, state: OdometryState, seen: _Seen) -> Registered:
        self._pieces.append(FusedPath(seen.timestamp_ns))
        self._map, self._threshold = SurfaceMap(self._kiss), self._kiss.threshold()
        self._twist_per_s, self._scans = None, ScanWitness()
        self._remember(seen, np.eye(4))
        return Registered(state)

    def _go_on(
        self, state: OdometryState, step: CameraStep, seen: _Seen, last: _Seen
    ) -> Registered:
        path = self._pieces[-1]
        seconds = (seen.timestamp_ns - last.timestamp_ns) / NS_PER_S
        surfaces = self._map.surfaces()
        within_m = WITHIN_THRESHOLDS * float(self._threshold.get_threshold())
        check = self._checked(step, seen, last, surfaces, within_m)
        prior = self._prior(step, check, with_offset=seen.scan is not None)
        by_scan = self._scans.align(seen.scan, prior) if seen.scan else None
        found = by_scan or align(seen.some, surfaces, prior, within_m=within_m)
        self._threshold.update_model_deviation(inverted(prior.T_odom_sensor) @ found.T_odom_sensor)
        self._remember(seen, found.T_odom_sensor)
        if check.wrong:
            doubt = np.asarray(np.linalg.inv(prior.information))
            step = replace(step, covariance=doubt, by_offset=np.zeros(6))
        # A scan has put right by then what vision learns later of the rig.
        follows = float(not check.wrong and by_scan is None)
        fused = _fused(path.T_odom_camera, step, prior, found, follows=follows)
        path.add(seen.timestamp_ns, fused)
        self._twist_per_s = log_twist(fused.T_from_to) / seconds
        return Registered(self._told(state, step, fused), check, found, by_scan is not None)

    def _checked(
        self, step: CameraStep, seen: _Seen, last: _Seen, surfaces: Surfaces, within_m: float
    ) -> StepCheck:
        T_odom, twist = self._pieces[-1].T_odom_camera, self._twist_per_s
        seconds = (seen.timestamp_ns - last.timestamp_ns) / NS_PER_S

        def map_score(T_from_to: Float64) -> float:
            at = Prior(T_odom @ T_from_to, np.eye(6))
            return lying_at(seen.some, surfaces, at, within_m=within_m).score

        return checked(
            step.T_from_to,
            None if twist is None else exp_twist(seconds * twist),
            SecondLook(last.grey, seen.grey, seen.patches, self._rig),
            map_score,
        )

    def _prior(self, step: CameraStep, check: StepCheck, *, with_offset: bool) -> Prior:
        """What vision knows; the offset's doubt is none of patches, which share it."""
        T_prior = self._pieces[-1].T_odom_camera @ check.T_from_to
        if check.wrong:
            return Prior.within(T_prior, metres=REPLACED_M, rad=REPLACED_RAD)
        covariance = step.covariance
        if with_offset:
            by_offset = step.by_offset * self._visual.offset.sigma_px
            covariance = covariance + np.outer(by_offset, by_offset)
        return Prior(T_prior, np.asarray(np.linalg.inv(covariance)))

    def _told(self, state: OdometryState, step: CameraStep, fused: FusedStep) -> OdometryState:
        """Vision's state with the pose, the step and the doubts that are right in the end."""
        path = self._pieces[-1]
        return replace(
            state,
            T_odom_camera=Pose(ODOM, self._rig.left.frame, path.T_odom_camera),
            step=replace(
                step,
                T_from_to=fused.T_from_to,
                covariance=fused.covariance,
                by_offset=fused.by_offset,
            ),
            covariance=path.doubt.total(self._visual.offset),
        )

    def _remember(self, seen: _Seen, T_odom_camera: Float64) -> None:
        patches = seen.patches
        self._map.add(patches.xyz[patches.depth_m < MAPPED_M], T_odom_camera)
        if seen.scan:
            self._scans.remember(seen.scan, T_odom_camera)


def _fused(
    T_odom_last: Float64, step: CameraStep, prior: Prior, found: Alignment, *, follows: float
) -> FusedStep:
    """The step that was found, and how far it follows vision's when that is put right."""
    total = np.asarray(np.linalg.inv(found.information))
    gain = total @ prior.information
    others = found.information - prior.information
    return FusedStep(
        inverted(T_odom_last) @ found.T_odom_sensor,
        step.T_from_to,
        follows * gain,
        gain @ step.covariance @ gain.T + total @ others @ total,
        gain @ step.by_offset,
    )
