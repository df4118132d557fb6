"""The path of fused odometry, put right once more is known of vision's steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.twists import exp_twist, inverted, log_twist, rigid
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.mapping.path import Doubt, stacked
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import Trajectory


@dataclass(frozen=True, eq=False)
class FusedStep:
    """A step that vision and other witnesses agreed on.

    Args:
        T_from_to: (4, 4) the step.
        T_vision: (4, 4) vision's, as it was told.
        gain: (6, 6) how much of a change of vision's step, a twist on its right, the step takes
            over; 0 where vision was wrong or a scan took part, almost 1 where others add little.
        covariance: (6, 6) of a twist on its right, without that of the rig's offset.
        by_offset: (6,) per px of offset, which all steps share.
    """

    T_from_to: Float64
    T_vision: Float64
    gain: Float64
    covariance: Float64
    by_offset: Float64

    def with_vision(self, T_vision: Float64) -> Float64:
        """(4, 4) the step as it would have been, had vision told this one."""
        return self.T_from_to @ exp_twist(self.gain @ log_twist(inverted(self.T_vision) @ T_vision))


class FusedPath:
    """A piece of path.

    Args:
        timestamp_ns: of its first frame.
    """

    def __init__(self, timestamp_ns: int) -> None:
        self._times_ns = [timestamp_ns]
        self._steps: list[FusedStep] = []
        self.T_odom_camera = np.eye(4)
        self.doubt = Doubt.none()

    def add(self, timestamp_ns: int, step: FusedStep) -> None:
        """The next frame that was not lost."""
        self._times_ns.append(timestamp_ns)
        self._steps.append(step)
        # Rounding errors double with every step that takes a bent pose for rigid.
        self.T_odom_camera = rigid(self.T_odom_camera @ step.T_from_to)
        self.doubt = self.doubt.after_step(step.T_from_to, step.covariance, step.by_offset)

    def settled(self, vision: Trajectory, offset: Offset) -> Trajectory:
        """All poses `T_odom_camera` with what is known by now.

        Args:
            vision: of the same frames, as vision has them by now.
            offset: of the rig, as known by now.
        """
        poses, doubt = [np.eye(4)], Doubt.none()
        covariances = [doubt.total(offset)]
        T = vision.T_world_body
        for before, after, step in zip(T[:-1], T[1:], self._steps, strict=True):
            T_from_to = step.with_vision(inverted(before) @ after)
            poses.append(rigid(poses[-1] @ T_from_to))
            doubt = doubt.after_step(T_from_to, step.covariance, step.by_offset)
            covariances.append(doubt.total(offset))
        return stacked(self._times_ns, poses, covariances)
