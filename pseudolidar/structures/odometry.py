"""How a camera moved, and where it is thereby: what odometry tells of each frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from pseudolidar.errors import OdometryLost, StructureError
from pseudolidar.structures.arrays import Float64, check_array
from pseudolidar.structures.point_tracks import PointTracks
from pseudolidar.structures.pose import Pose

# `first` of a piece of path, `ok`, `extrapolated`: where it would be if it went on as before, or
# `lost`: nobody knows where.
OdometryStatus = Literal["first", "ok", "extrapolated", "lost"]
# Of frames of which something was seen of how they moved, or that a piece of path begins at.
MEASURED: tuple[OdometryStatus, ...] = ("first", "ok")
# A point that was followed agrees with a motion if it has this weight, of 0 to 1.
AGREES = 0.5


@dataclass(frozen=True, eq=False)
class CameraStep:
    """How the left camera moved from an earlier frame to a later one.

    Args:
        T_from_to: (4, 4) float64 maps points of the later left camera into the earlier one, which
            is the later camera's pose in the earlier one, metres; optical axes (x right, y down,
            z forward).
        covariance: (6, 6) float64 of a twist on its right, `T_from_to exp(xi)`: `xi` is the error
            as the later camera sees it, translation x, y, z in metres, then rotation vector, rad.
        frames: how many frames it spans; more than 1 across frames that were lost.
        by_offset: (6,) float64 per px: twist on its right that a larger offset of the rig's
            disparities makes. All steps share that offset, and the covariance is without it.
    """

    T_from_to: Float64
    covariance: Float64
    frames: int = 1
    by_offset: Float64 = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        check_array("CameraStep", "T_from_to", self.T_from_to, (4, 4), np.float64)
        check_array("CameraStep", "covariance", self.covariance, (6, 6), np.float64)
        check_array("CameraStep", "by_offset", self.by_offset, (6,), np.float64)
        if not self.frames >= 1:
            raise StructureError(f"{self.frames} frames", want="1 or more", where="CameraStep")

    @property
    def T_to_from(self) -> Float64:
        """(4, 4) maps points of the earlier camera into the later one."""
        R, t = self.T_from_to[:3, :3], self.T_from_to[:3, 3]
        inverse = np.eye(4)
        inverse[:3, :3], inverse[:3, 3] = R.T, -R.T @ t
        return inverse

    @property
    def information(self) -> Float64:
        """(6, 6) inverse of the covariance, the same order."""
        return np.asarray(np.linalg.inv(self.covariance))

    @property
    def distance_m(self) -> float:
        """How far the camera moved."""
        return float(np.linalg.norm(self.T_from_to[:3, 3]))


@dataclass(frozen=True, eq=False)
class OdometryState:
    """What odometry tells of one frame.

    Args:
        status: `first` of a piece, `ok`, `extrapolated` or `lost`.
        T_odom_camera: pose of the left camera; `odom` is the left camera of the piece's first
            frame. None where it is lost. Where it is extrapolated nothing was measured: it holds
            until a later frame says better, and no map or loop may rest on it.
        step: from the last frame that was measured; None at the first of a piece, and where
            nothing was.
        covariance: (6, 6) float64 of a twist on the right of `T_odom_camera`, order as in
            `CameraStep`: what all steps since the piece began add up to, and what the sensor may
            have done since; zero at its first frame, None where lost.
        piece: 0 at first; one more where odometry began anew after it was lost for long: poses of
            different pieces have nothing in common.
        tracks: points that the step rests on, for drawing: from the keyframe that the frame was
            compared with to the frame; none where there was no step.
        weights: (N,) 0-1 of each track: near 0 for wrong ones and things that move.
        keyframe_gap: how many frames before this one that keyframe was; 0 where there was no step.
        keyframe: whether the frames after this one are compared with it.
        why: what was missing, where nothing was measured, or by scans alone.
        offset_px: by how much the disparities of the rig are too large, and one standard deviation
            of that, as known with this frame; None where it is not looked for.
        ended: of the frame with which a piece of path is given up: it ends at the last frame that
            was measured.
    """

    status: OdometryStatus
    T_odom_camera: Pose | None = None
    step: CameraStep | None = None
    covariance: Float64 | None = None
    piece: int = 0
    tracks: PointTracks | None = None
    weights: Float64 = field(default_factory=lambda: np.zeros(0))
    keyframe_gap: int = 0
    keyframe: bool = False
    why: str = ""
    offset_px: tuple[float, float] | None = None
    ended: OdometryLost | None = None

    def __post_init__(self) -> None:
        if (self.status == "lost") != (self.T_odom_camera is None):
            raise StructureError(
                f"status {self.status} with pose {self.T_odom_camera}",
                want="a pose unless it is lost",
                where="OdometryState",
            )
        check_array("OdometryState", "weights", self.weights, (self.n_tracks,), np.float64)

    @property
    def measured(self) -> bool:
        """Whether something was seen of how it moved, or a piece of path begins here."""
        return self.status in MEASURED

    @property
    def measured_pose(self) -> Pose | None:
        """`T_odom_camera`, where it was measured: what maps and loops may rest on."""
        return self.T_odom_camera if self.measured else None

    @property
    def n_tracks(self) -> int:
        """How many points were followed."""
        return 0 if self.tracks is None else len(self.tracks)

    @property
    def inliers(self) -> int:
        """How many of them agree with the step."""
        return int((self.weights >= AGREES).sum())
