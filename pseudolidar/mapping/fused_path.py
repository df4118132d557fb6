"""The path of fused odometry, put right once more is known of vision's steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.pose_doubt import step_doubt
from pseudolidar.geometry.twists import carried, exp_twist, inverted, log_twist, rigid
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.mapping.path import Doubt, stacked
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import Trajectory


@dataclass(frozen=True, eq=False)
class VisionPart:
    """What of a step is vision's.

    Args:
        piece: of vision's path.
        first: frame of that piece that the step begins at.
        last: where it ends.
        T_from_to: (4, 4) vision's step, as it was told.
        gain: (6, 6) how much of a change of it, a twist on its right, the step takes over; 0 where
            vision was wrong or a scan took part, almost 1 where others add little.
    """

    piece: int
    first: int
    last: int
    T_from_to: Float64
    gain: Float64

    def change(self, vision: Sequence[Trajectory]) -> Float64:
        """(4, 4) on the right of a step, by vision's pieces as they are known by now."""
        before, after = vision[self.piece].T_world_body[[self.first, self.last]]
        now = inverted(before) @ after
        return exp_twist(self.gain @ log_twist(inverted(self.T_from_to) @ now))


@dataclass(frozen=True, eq=False)
class FusedStep:
    """A step that all who saw it agreed on.

    Args:
        T_from_to: (4, 4) the step.
        covariance: (6, 6) of a twist on its right, without that of the rig's offset.
        by_offset: (6,) per px of offset, which all steps share.
        vision: what of it is vision's; None of scans alone.
    """

    T_from_to: Float64
    covariance: Float64
    by_offset: Float64
    vision: VisionPart | None = None

    def settled(self, vision: Sequence[Trajectory]) -> Float64:
        """(4, 4) the step as it would have been, had vision told what it knows by now."""
        if self.vision is None:
            return self.T_from_to
        return self.T_from_to @ self.vision.change(vision)


@dataclass(frozen=True, eq=False)
class Place:
    """A frame of a piece of path.

    Args:
        number: counted from its first.
        timestamp_ns: when it was taken.
        T_odom_camera: (4, 4) where.
        doubt: how unsure that is.
    """

    number: int
    timestamp_ns: int
    T_odom_camera: Float64
    doubt: Doubt

    def to(self, later: Place) -> Float64:
        """(4, 4) `T_from_to` of the way to a later place."""
        return inverted(self.T_odom_camera) @ later.T_odom_camera


class FusedPath:
    """A piece of path. Each frame hangs at an earlier one: at the last, or the last of vision.

    Args:
        timestamp_ns: of its first frame.
    """

    def __init__(self, timestamp_ns: int) -> None:
        self.last = Place(0, timestamp_ns, np.eye(4), Doubt.none())
        self._times_ns = [timestamp_ns]
        self._hung: list[tuple[int, FusedStep]] = []

    def add(self, timestamp_ns: int, step: FusedStep, at: Place | None = None) -> Place:
        """The next frame that was placed, by a step from the last one or from an earlier place."""
        start = self.last if at is None else at
        self._times_ns.append(timestamp_ns)
        self._hung.append((start.number, step))
        # Rounding errors double with every step that takes a bent pose for rigid.
        T = rigid(start.T_odom_camera @ step.T_from_to)
        doubt = start.doubt.after_step(step.T_from_to, step.covariance, step.by_offset)
        self.last = Place(len(self._hung), timestamp_ns, T, doubt)
        return self.last

    def settled(self, vision: Sequence[Trajectory], offset: Offset) -> Trajectory:
        """All poses `T_odom_camera` with what is known by now.

        Args:
            vision: its pieces, as it has them by now.
            offset: of the rig, as known by now.
        """
        poses, doubts = [np.eye(4)], [Doubt.none()]
        for start, step in self._hung:
            T_from_to = step.settled(vision)
            poses.append(rigid(poses[start] @ T_from_to))
            doubts.append(doubts[start].after_step(T_from_to, step.covariance, step.by_offset))
        return stacked(self._times_ns, poses, [doubt.total(offset) for doubt in doubts])


def step_between(last: Place, start: Place, now: Place, step: FusedStep) -> tuple[Float64, Float64]:
    """The way from the last place to the one now (4, 4), and its doubt (6, 6).

    Args:
        last: before now.
        start: where the step to now begins; the last, or an earlier one that the last hangs at.
        now: where it ends.
        step: it.
    """
    T_from_to = last.to(now)
    strayed = step_doubt(start.doubt.covariance, last.doubt.covariance, start.to(last))
    return T_from_to, step.covariance + carried(strayed, T_from_to)
