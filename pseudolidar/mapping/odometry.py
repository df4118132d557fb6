"""Where the sensors were: by vision, by KISS-ICP on scans, or by both and what they check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from pseudolidar.errors import ScanMissing
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.geometry.twists import adjoint, exp_twist, inverted, log_twist
from pseudolidar.mapping.alignment import Alignment, Prior, align, lying_at
from pseudolidar.mapping.integrity import StepCheck, checked
from pseudolidar.mapping.kiss_library import load_kiss
from pseudolidar.mapping.patches import Patches, find_patches
from pseudolidar.mapping.scan_odometry import ScanOdometry
from pseudolidar.mapping.second_look import SecondLook
from pseudolidar.mapping.surface_map import SurfaceMap, Surfaces
from pseudolidar.mapping.visual_odometry import VisualChain, VisualOdometry
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose

# A map of stereo patches: side of its voxels, reach, depth of what enters it, and how far
# predictions are off at first, m.
VOXEL_M, REACH_M, MAPPED_M, FIRST_THRESHOLD_M = 0.4, 40.0, 25.0, 0.15
# Patches are matched within so many of KISS-ICP's thresholds.
WITHIN_THRESHOLDS = 3.0
# So many patches of a frame say what all of them say.
MOST_PATCHES = 1500
# How well a step is known that took a wrong one's place, one standard deviation, m and rad.
REPLACED_M, REPLACED_RAD = 0.02, 0.002


@dataclass(frozen=True, eq=False)
class Registered:
    """What odometry tells of a frame.

    Args:
        state: as vision tells it, of the pose that is right in the end.
        check: what other witnesses said of vision's step; None where there was none.
        alignment: how the frame lies on the map; None without a map.
    """

    state: OdometryState
    check: StepCheck | None = None
    alignment: Alignment | None = None


@dataclass(frozen=True)
class Vision:
    """Stereo visual odometry alone.

    Args:
        visual: its settings.
    """

    visual: VisualOdometry = field(default_factory=VisualOdometry)

    def start(self, rig: StereoRig) -> VisionChain:
        """Begin with the first frame to come."""
        return VisionChain(self.visual.start(rig))


@dataclass(frozen=True)
class Kiss:
    """KISS-ICP on the scans of a LiDAR, with the vision left out.

    Args:
        scans: its settings.
    """

    scans: ScanOdometry = field(default_factory=ScanOdometry)

    def start(self, rig: StereoRig) -> KissChain:
        """Begin with the first frame to come.

        Raises:
            MissingDependency: kiss-icp is absent.
        """
        return KissChain(self, rig)


@dataclass(frozen=True)
class Fused:
    """Stereo visual odometry whose every step is checked and laid on KISS-ICP's map.

    Args:
        visual: settings of vision.
    """

    visual: VisualOdometry = field(default_factory=VisualOdometry)

    def start(self, rig: StereoRig) -> FusedChain:
        """Begin with the first frame to come.

        Raises:
            MissingDependency: kiss-icp is absent.
        """
        return FusedChain(self.visual.start(rig), rig)


Odometry: TypeAlias = Vision | Kiss | Fused


class VisionChain:
    """Vision as `Registered` has it.

    Args:
        visual: begun.
    """

    def __init__(self, visual: VisualChain) -> None:
        self._visual = visual

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> Registered:
        """Where the next frame was taken."""
        return Registered(self._visual.register(frame, disparity, movable))


class KissChain:
    """Poses of the left camera by the scans that come with frames.

    Args:
        settings: as declared.
        rig: places the LiDAR.
    """

    def __init__(self, settings: Kiss, rig: StereoRig) -> None:
        self._scans, self._rig = settings.scans.start(), rig

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> Registered:
        """Where the next frame was taken; disparities and movable things are not looked at.

        Raises:
            ScanMissing: a frame without scan, or a rig that does not know where the LiDAR is.
        """
        del disparity, movable
        T_left_lidar = self._rig.T_left_velodyne
        if frame.scan is None or T_left_lidar is None:
            raise ScanMissing(
                "a frame without a scan" if frame.scan is None else "a LiDAR without a place",
                want="scans that are calibrated to the left camera",
                fix="Take --odometry fused: KISS-ICP alone slides on clouds of stereo.",
                where=f"frame {frame.id}",
            )
        state = self._scans.register(frame.scan, frame.timestamp_ns)
        return Registered(_of_camera(state, T_left_lidar))


def _of_camera(state: OdometryState, T_camera_sensor: Pose) -> OdometryState:
    """The state of a sensor's chain as that of the camera that it is fixed to."""
    if state.T_odom_camera is None or state.covariance is None:
        return state
    T = T_camera_sensor.matrix
    back, turn = inverted(T), adjoint(T)
    step = state.step and CameraStep(
        T @ state.step.T_from_to @ back, turn @ state.step.covariance @ turn.T, state.step.frames
    )
    pose = Pose(ODOM, T_camera_sensor.dst, T @ state.T_odom_camera.matrix @ back)
    covariance = turn @ state.covariance @ turn.T
    return OdometryState(state.status, pose, step=step, covariance=covariance, piece=state.piece)


@dataclass(frozen=True, eq=False)
class _At:
    """The last frame that was placed."""

    T_odom_camera: Float64
    covariance: Float64
    grey: UInt8
    timestamp_ns: int
    twist_per_s: Float64 | None


class FusedChain:
    """Vision's steps, checked and laid on the map, in order.

    Args:
        visual: begun; anything that tells steps as it does.
        rig: rectified.
    """

    def __init__(self, visual: VisualChain, rig: StereoRig) -> None:
        self._visual, self._rig = visual, rig
        self._kiss = load_kiss(voxel_m=VOXEL_M, farthest_m=REACH_M, threshold_m=FIRST_THRESHOLD_M)
        self._last: _At | None = None

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
        grey = grey8_pair(frame.left, frame.right)[0]
        if state.step is None or self._last is None:
            return self._begin(state, patches, grey, frame.timestamp_ns)
        return self._go_on(state, state.step, self._last, patches, grey, frame.timestamp_ns)

    def _begin(
        self, state: OdometryState, patches: Patches, grey: UInt8, timestamp_ns: int
    ) -> Registered:
        self._map, self._threshold = SurfaceMap(self._kiss), self._kiss.threshold()
        self._remember(patches, np.eye(4))
        self._last = _At(np.eye(4), np.zeros((6, 6)), grey, timestamp_ns, None)
        return Registered(state)

    def _go_on(
        self,
        state: OdometryState,
        step: CameraStep,
        last: _At,
        patches: Patches,
        grey: UInt8,
        timestamp_ns: int,
    ) -> Registered:
        seconds = (timestamp_ns - last.timestamp_ns) / NS_PER_S
        surfaces = self._map.surfaces()
        some = patches[:: max(1, len(patches) // MOST_PATCHES)]
        within_m = WITHIN_THRESHOLDS * float(self._threshold.get_threshold())
        predicted = None if last.twist_per_s is None else exp_twist(seconds * last.twist_per_s)
        check = checked(
            step.T_from_to,
            predicted,
            SecondLook(last.grey, grey, patches, self._rig),
            lambda T: _score(some, surfaces, last.T_odom_camera @ T, within_m),
        )
        T_prior = last.T_odom_camera @ check.T_from_to
        prior = Prior(T_prior, step.information)
        if check.wrong:
            prior = Prior.within(T_prior, metres=REPLACED_M, rad=REPLACED_RAD)
        found = align(some, surfaces, prior, within_m=within_m)
        T = found.T_odom_sensor
        self._threshold.update_model_deviation(inverted(T_prior) @ T)
        self._remember(patches, T)
        T_from_to = inverted(last.T_odom_camera) @ T
        covariance = np.asarray(np.linalg.inv(found.information))
        seen_from_end = adjoint(inverted(T_from_to))
        total = seen_from_end @ last.covariance @ seen_from_end.T + covariance
        self._last = _At(T, total, grey, timestamp_ns, log_twist(T_from_to) / seconds)
        placed = OdometryState(
            "ok",
            Pose(ODOM, self._rig.left.frame, T),
            step=CameraStep(T_from_to, covariance, frames=step.frames),
            covariance=total,
            piece=state.piece,
            tracks=state.tracks,
            weights=state.weights,
            keyframe_gap=state.keyframe_gap,
            keyframe=state.keyframe,
        )
        return Registered(placed, check, found)

    def _remember(self, patches: Patches, T_odom_camera: Float64) -> None:
        self._map.add(patches.xyz[patches.depth_m < MAPPED_M], T_odom_camera)


def _score(patches: Patches, surfaces: Surfaces, T: Float64, within_m: float) -> float:
    return lying_at(patches, surfaces, Prior(T, np.eye(6)), within_m=within_m).score
