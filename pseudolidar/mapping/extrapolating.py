"""Poses for frames that odometry loses for a moment, marked as what they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.errors import OdometryLost
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.twists import gone_on, log_twist, rigid
from pseudolidar.mapping.registered import OdometryChain, Registered
from pseudolidar.mapping.scan_counts import ScanCounts
from pseudolidar.mapping.steadiness import Steadiness
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose, Trajectory

# Nobody is said to have gone on farther than this, m, however steadily they went and few frames are
# lost: 25 m without a measurement are no path (fault 48). Five frames at 30 m/s and 10 a second
# are 15 m. Chosen, 2026-11.
FARTHEST_M = 25.0


class ExtrapolatingChain:
    """Any odometry, which tells where a frame would be that it loses for a moment.

    Args:
        chain: begun.
        reach: frames in a row that may be extrapolated. With one more the piece of path has ended
            at the last frame that was measured.
    """

    def __init__(self, chain: OdometryChain, *, reach: int) -> None:
        self._chain, self._reach = chain, reach
        self._last: _Last | None = None
        self._steadiness = Steadiness()
        self._lost = 0

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now."""
        return self._chain.correction

    @property
    def scan_counts(self) -> ScanCounts | None:
        """What was odd about scans so far; None where scans are not looked at."""
        return self._chain.scan_counts

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses of all frames that were measured, piece by piece; `bridged` adds those between."""
        return self._chain.trajectories()

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> Registered:
        """Where the next frame was taken, or would be if the sensors went on as before.

        Raises:
            SequenceTime: the frame is not later than the one before.
        """
        registered = self._chain.register(frame, disparity, movable)
        state = registered.state
        if state.measured:
            return replace(registered, state=self._measured(state, frame))
        return replace(registered, state=self._going_on(state, frame))

    def _measured(self, state: OdometryState, frame: StereoFrame) -> OdometryState:
        begins = state.status == "first"
        if begins and self._last is not None:
            state = replace(state, ended=self._last.not_joined(frame.id, self._reach))
        last = None if begins else self._last
        self._last, self._lost = _Last.of(state, frame, last), 0
        if last is not None and last.twist_per_s is not None:
            now = self._last
            seconds = 0.5 * (last.step_s + now.step_s)
            assert now.twist_per_s is not None  # a step led to it
            self._steadiness = self._steadiness.after(last.twist_per_s, now.twist_per_s, seconds)
        return state

    def _going_on(self, state: OdometryState, frame: StereoFrame) -> OdometryState:
        last = self._last
        if last is None:
            return state
        self._lost += 1
        if self._lost > self._reach:
            self._last = None
            return replace(state, ended=last.left_behind(self._reach, state.why))
        told = last.further(frame.timestamp_ns, self._steadiness)
        if told is None:
            return state
        pose = Pose(ODOM, last.pose.src, rigid(told[0]))
        return replace(state, status="extrapolated", T_odom_camera=pose, covariance=told[1])


@dataclass(frozen=True, eq=False)
class _Last:
    """The last frame that was measured.

    Args:
        name: of the frame.
        timestamp_ns: when it was taken.
        pose: where.
        covariance: (6, 6) how sure that is.
        twist_per_s: (6,) of the step to it; None of the first of a piece.
        step: (6, 6) how sure that is.
        step_s: how long it took.
    """

    name: str
    timestamp_ns: int
    pose: Pose
    covariance: Float64
    twist_per_s: Float64 | None = None
    step: Float64 = field(default_factory=lambda: np.zeros((6, 6)))
    step_s: float = 0.0

    @classmethod
    def of(cls, state: OdometryState, frame: StereoFrame, before: _Last | None) -> _Last:
        """From what odometry told of it, and the one before on the same piece."""
        assert state.T_odom_camera is not None  # it was measured
        assert state.covariance is not None
        at = cls(frame.id, frame.timestamp_ns, state.T_odom_camera, state.covariance)
        if before is None or state.step is None:
            return at
        return at._after(state.step, (frame.timestamp_ns - before.timestamp_ns) / NS_PER_S)

    def _after(self, step: CameraStep, seconds: float) -> _Last:
        twist_per_s = log_twist(step.T_from_to) / seconds
        return replace(self, twist_per_s=twist_per_s, step=step.covariance, step_s=seconds)

    def further(self, timestamp_ns: int, steadiness: Steadiness) -> tuple[Float64, Float64] | None:
        """Pose (4, 4) at a later time, if it goes on as before, and its doubt (6, 6).

        None where no motion was seen yet, and where it would be too far, or too unsure.
        """
        if self.twist_per_s is None:
            return None
        seconds = (timestamp_ns - self.timestamp_ns) / NS_PER_S
        doubt = steadiness.gone_on(
            self.covariance, self.step, self.twist_per_s, self.step_s, seconds
        )
        if doubt.too_unsure or seconds * np.linalg.norm(self.twist_per_s[:3]) > FARTHEST_M:
            return None
        return gone_on(self.pose.matrix, self.twist_per_s, seconds), doubt.total

    def left_behind(self, reach: int, why: str) -> OdometryLost:
        """The path ends here, for nothing was measured of too many frames after it."""
        return OdometryLost(
            f"the path ends here: the frames after it, more than {reach} in a row, tell nothing of "
            f"how they moved ({why})",
            want=f"at most {reach}",
            where=f"frame {self.name}",
        )

    def not_joined(self, later: str, reach: int) -> OdometryLost:
        """The path ends here, though scans may have carried on until a later frame (its name)."""
        return OdometryLost(
            f"the path ends here: vision begins anew at frame {later}, and no scan joins it",
            want=f"a scan that lies on the map, or vision lost {reach} times in a row at most",
            where=f"frame {self.name}",
        )
