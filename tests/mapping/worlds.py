"""Rendered worlds with the poses that their left camera really had."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.trajectory.segments import SegmentLengths, segment_errors
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import inverted, log_twist
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import OdometryState
from pseudolidar.structures.pose import Trajectory


@dataclass(frozen=True, eq=False)
class Drive:
    """Frames and poses.

    Args:
        rig: of all frames.
        frames: with exact disparities.
        T_odom: (N, 4, 4) of the left camera in that of the first frame.
    """

    rig: StereoRig
    frames: list[StereoFrame]
    T_odom: np.ndarray

    @classmethod
    @functools.cache
    def through(cls, world: str, frames: int, **options: int) -> Drive:
        source = Synthetic(world, frames=frames, **options).open()
        return cls.of([source.load(i) for i in range(frames)])

    @classmethod
    def of(cls, frames: list[StereoFrame]) -> Drive:
        T_base_left = left_in_base_link(frames[0].rig).matrix
        T_map = np.stack([frame.pose.matrix @ T_base_left for frame in frames])
        return cls(frames[0].rig, frames, inverted(T_map[0]) @ T_map)

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.T_odom[:, :3, 3], axis=0), axis=1).sum())

    def error_rel(self, state: OdometryState, at: int = -1) -> float:
        """Error of a pose as a share of the whole length."""
        error_m = state.T_odom_camera.translation_m - self.T_odom[at, :3, 3]
        return float(np.linalg.norm(error_m)) / self.length_m

    def step_nees(self, states: list[OdometryState]) -> list[float]:
        """Normalised squared errors of all steps, by their number of dimensions: 1 is honest."""
        nees = []
        for at, state in enumerate(states):
            if state.step is None:
                continue
            T = inverted(self.T_odom[at - state.step.frames]) @ self.T_odom[at]
            error = log_twist(state.step.T_to_from @ T)
            nees.append(error @ state.step.information @ error / 6)
        return nees

    def pose_nees(self, at: int, state: OdometryState) -> float:
        """As `step_nees`, of a pose."""
        error = log_twist(state.T_odom_camera.inverse().matrix @ self.T_odom[at])
        return float(error @ np.linalg.inv(state.covariance) @ error / 6)

    def path_nees(self, path: Trajectory) -> float:
        """As `pose_nees`, of the last pose of a path of all frames."""
        error = log_twist(inverted(path.T_world_body[-1]) @ self.T_odom[-1])
        return float(error @ np.linalg.inv(path.covariance[-1]) @ error / 6)


@dataclass(frozen=True)
class Drift:
    """Errors of a path.

    Args:
        end_rel: of its end, by its length.
        t_rel: mean over pieces, by their length.
        r_deg_per_m: mean over pieces.
    """

    end_rel: float
    t_rel: float
    r_deg_per_m: float


def drift(T_odom: np.ndarray, truth: np.ndarray) -> Drift:
    """Against exact poses that begin at the same place: over 10-40 m, or all of shorter paths."""
    pieces = segment_errors(T_odom, truth, SegmentLengths("auto"))
    end_m = np.linalg.norm(T_odom[-1, :3, 3] - truth[-1, :3, 3])
    length_m = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum()
    return Drift(float(end_m / length_m), pieces.mean_t_rel, pieces.mean_r_rel_deg_per_m)
