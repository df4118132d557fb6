"""How stereo cameras move, from what their pictures show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.pnp import RelativePose
from pseudolidar.geometry.tracking import MatchedPair, precise_pose, relative_pose
from pseudolidar.geometry.twists import adjoint
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose

# Tracks of a pair share the errors of what they see and are too sure of it by so much: variance.
TOO_SURE = 10.0


@dataclass(frozen=True)
class VisualOdometry:
    """Stereo visual odometry.

    Args:
        least_inliers: points that must agree on a step; with fewer the frame is lost.
        reach: frames that a step may bridge when those between were lost; afterwards a new piece
            of path begins.
    """

    least_inliers: int = 30
    reach: int = 5

    def start(self, rig: StereoRig) -> VisualChain:
        """Begin with the cameras of all frames to come.

        Raises:
            UsageError: numbers that mean nothing.
        """
        if self.least_inliers < 6 or self.reach < 1:
            raise UsageError(
                f"least_inliers {self.least_inliers}, reach {self.reach}",
                want="at least 6 points and 1 frame",
            )
        return VisualChain(self, rig)


class VisualChain:
    """Frames chained by what they show, in order.

    Args:
        settings: as declared.
        rig: rectified.
    """

    def __init__(self, settings: VisualOdometry, rig: StereoRig) -> None:
        self._settings, self._rig = settings, rig
        self._last: MatchedPair | None = None
        self._state = OdometryState("first", Pose.identity(ODOM, rig.left.frame))
        self._T_to_from = np.eye(4)
        self._lost = 0

    def register(self, frame: StereoFrame, disparity: DisparityMap) -> OdometryState:
        """Where the next frame was taken."""
        pair = MatchedPair.of(frame, disparity)
        if self._last is None:
            return self._begin(pair, piece=0)
        found = self._motion(self._last, pair)
        if isinstance(found, str):
            return self._lose(pair, found)
        step = CameraStep(
            np.asarray(np.linalg.inv(found.T_to_from)),
            np.asarray(TOO_SURE * np.linalg.inv(found.information)),
            frames=self._lost + 1,
        )
        self._T_to_from = found.T_to_from
        self._last, self._lost = pair, 0
        self._state = chained(self._state, step, found)
        return self._state

    def _begin(self, pair: MatchedPair, *, piece: int) -> OdometryState:
        self._last, self._lost, self._T_to_from = pair, 0, np.eye(4)
        origin = Pose.identity(ODOM, self._rig.left.frame)
        self._state = OdometryState("first", origin, covariance=np.zeros((6, 6)), piece=piece)
        return self._state

    def _lose(self, pair: MatchedPair, why: str) -> OdometryState:
        self._lost += 1
        piece = self._state.piece
        if self._lost > self._settings.reach:
            return self._begin(pair, piece=piece + 1)
        return OdometryState("lost", piece=piece, why=why)

    def _motion(self, before: MatchedPair, pair: MatchedPair) -> RelativePose | str:
        """The motion, or why there is none."""
        rough = relative_pose(before, pair, self._rig, self._T_to_from)
        if rough is None:
            return "too few points agree on a motion"
        precise = precise_pose(before, pair, self._rig, rough.T_to_from) or rough
        inliers = int((precise.weights >= 0.5).sum())
        if inliers < self._settings.least_inliers:
            return f"{inliers} points agree on a motion, {self._settings.least_inliers} are needed"
        return precise


def chained(before: OdometryState, step: CameraStep, found: RelativePose) -> OdometryState:
    """The state after a step; its covariance is that of the state before, seen from its end."""
    assert before.T_odom_camera is not None
    assert before.covariance is not None
    frame = before.T_odom_camera.src
    pose = before.T_odom_camera @ Pose(frame, frame, step.T_from_to)
    seen_from_end = adjoint(step.T_to_from)
    covariance = seen_from_end @ before.covariance @ seen_from_end.T + step.covariance
    return OdometryState(
        "ok",
        pose,
        step=step,
        covariance=covariance,
        piece=before.piece,
        tracks=found.tracks,
        weights=found.weights,
    )
