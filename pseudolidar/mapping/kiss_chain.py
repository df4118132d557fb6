"""The left camera's path by the scans of a LiDAR alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.errors import ScanMissing
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.twists import adjoint, inverted
from pseudolidar.mapping.path import stacked
from pseudolidar.mapping.registered import Registered
from pseudolidar.mapping.scan_counts import ScanCounts
from pseudolidar.mapping.scan_odometry import ScanChain
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose, Trajectory


class KissChain:
    """Poses of the left camera by the scans that come with frames.

    Args:
        scans: begun.
        rig: places the LiDAR.
    """

    def __init__(self, scans: ScanChain, rig: StereoRig) -> None:
        self._scans, self._rig = scans, rig
        self._told: list[tuple[int, OdometryState]] = []

    @property
    def correction(self) -> DisparityCorrection | None:
        """That of the rig: scans say nothing of disparities."""
        return self._rig.correction

    @property
    def scan_counts(self) -> ScanCounts:
        """What was odd about scans so far."""
        return self._scans.counts

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
        state = of_camera(state, T_left_lidar)
        self._told.append((frame.timestamp_ns, state))
        return Registered(state, sensors="scan" if state.measured else "none")

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses of the left camera as they were told, with covariances, piece by piece."""
        pieces: dict[int, list[tuple[int, Pose, OdometryState]]] = {}
        for timestamp_ns, state in self._told:
            if state.T_odom_camera is not None:
                one = (timestamp_ns, state.T_odom_camera, state)
                pieces.setdefault(state.piece, []).append(one)
        return tuple(
            stacked(
                [timestamp_ns for timestamp_ns, _, _ in piece],
                [pose.matrix for _, pose, _ in piece],
                [np.asarray(state.covariance) for _, _, state in piece],
            )
            for piece in pieces.values()
        )


def of_camera(state: OdometryState, T_camera_sensor: Pose) -> OdometryState:
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
