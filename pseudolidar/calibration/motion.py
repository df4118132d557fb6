"""The disparity offset of a rig from the motion of a sequence, where there is no LiDAR."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.far_points import FarPoints, far_disparities
from pseudolidar.calibration.motion_fit import MotionFit, fitted
from pseudolidar.calibration.motion_scale import ScaleFrom
from pseudolidar.errors import UsageError
from pseudolidar.geometry.pnp import RelativePose
from pseudolidar.geometry.tracking import MatchedPair, precise_pose, relative_pose
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig


@dataclass(frozen=True)
class Motion:
    """From the motion of the cameras: what comes nearer grows in picture and disparity alike.

    Args:
        gap: how many frames apart the pictures are that are compared; single steps are too small.
        most: motions that are used, taken evenly from longer sequences.
        scale: what the scale of the depths follows, which motion cannot see: `poses` of the source,
            where they come from another sensor (GPS, IMU); `near` depths stay as calibrated, which
            was done near the cameras; `kept`, for cameras that turned since; `auto` is poses where
            they tell it surely, else near.
    """

    gap: int = 3
    most: int = 60
    scale: ScaleFrom = "auto"

    def __post_init__(self) -> None:
        if self.gap < 1 or self.most < 1:
            raise UsageError(
                f"gap {self.gap}, most {self.most}",
                want="1 or more of each",
                fix="Leave them out: 3 and 60 are right for 10 frames a second.",
            )

    def starts(self, frames: int) -> tuple[int, ...]:
        """First frames of the motions that are used of a sequence of so many frames."""
        possible = frames - self.gap
        if possible <= self.most:
            return tuple(range(possible))
        return tuple(int(start) for start in np.linspace(0, possible - 1, self.most).round())

    def needed(self, frames: int) -> tuple[int, ...]:
        """Positions of the frames that have to be looked at, increasing."""
        needed = {start + step for start in self.starts(frames) for step in range(self.gap + 1)}
        return tuple(sorted(needed))

    def load(self, rig: StereoRig, frames: int) -> MotionEstimator:
        """What follows a sequence of so many frames, all of this rig."""
        return MotionEstimator(rig, self.gap, frozenset(self.starts(frames)), self.scale)


class MotionEstimator:
    """Follows points through a sequence; give it the frames in order.

    Args:
        rig: rectified; its correction is not used, as a new one is sought.
        gap: how many frames apart the compared pairs are.
        starts: first frames of the compared pairs.
        scale: what the scale of the depths follows.
    """

    def __init__(
        self, rig: StereoRig, gap: int, starts: frozenset[int], scale: ScaleFrom = "auto"
    ) -> None:
        self._rig, self._gap, self._starts, self._scale = rig, gap, starts, scale
        self._recent: deque[_Seen] = deque(maxlen=gap + 1)
        self._motions: list[RelativePose] = []
        self._surveyed: list[Float64] = []
        self._far: list[Float64] = []
        self._frames = 0

    def add(self, position: int, pair: MatchedPair, T_map_left: Float64 | None = None) -> None:
        """Look at a frame.

        Args:
            position: in the sequence; frames may be left out, and tell nothing then.
            pair: its pictures.
            T_map_left: (4, 4) where the left camera was, if somebody else knows. The offset does
                not follow it; the scale of the depths may.
        """
        self._frames += 1
        seen = _Seen(position, pair, np.eye(4), np.eye(4), T_map_left)
        before = self._recent[-1] if self._recent else None
        if before is None or before.position != position - 1:
            self._recent.clear()
        else:
            step = relative_pose(before.pair, pair, self._rig, before.T_step)
            if step is None:
                self._recent.clear()
            else:
                T = step.T_to_from
                seen = _Seen(position, pair, T, T @ before.T_chain, T_map_left)
                self._far.append(far_disparities(before.pair, pair, self._rig, T))
        self._recent.append(seen)
        first = self._recent[0]
        if first.position == position - self._gap and first.position in self._starts:
            T_to_from = seen.T_chain @ np.linalg.inv(first.T_chain)
            motion = precise_pose(first.pair, pair, self._rig, T_to_from)
            if motion is not None:
                self._motions.append(motion)
                if first.T_map_left is not None and T_map_left is not None:
                    self._surveyed.append(np.linalg.inv(T_map_left) @ first.T_map_left)

    def fit(self) -> MotionFit:
        """The offset of all that was seen.

        Raises:
            MotionInsufficient: the sequence does not carry it; says what is missing.
        """
        return fitted(
            self._motions,
            self._rig,
            frames=self._frames,
            gap=self._gap,
            far=FarPoints.of(self._far),
            surveyed=self._surveyed,
            scale=self._scale,
        )


@dataclass(frozen=True, eq=False)
class _Seen:
    """A frame of the recent past.

    Args:
        position: of the frame.
        pair: its pictures.
        T_step: (4, 4) motion from the frame before.
        T_chain: (4, 4) motion from the start of the chain of steps.
        T_map_left: (4, 4) where the camera was, if somebody else knows.
    """

    position: int
    pair: MatchedPair
    T_step: Float64
    T_chain: Float64
    T_map_left: Float64 | None
