"""How stereo cameras move, from what their pictures show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import SequenceTime, StructureError, UsageError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.pnp import RelativePose
from pseudolidar.geometry.pose_doubt import unsure_m
from pseudolidar.geometry.tracking import MatchedPair
from pseudolidar.geometry.twists import adjoint, carried, gone_on, inverted, log_twist
from pseudolidar.mapping.disparity_offset import Offset, OffsetEstimate, by_offset, unscaled
from pseudolidar.mapping.keyframe import Keyframe, Sight, movable_pixels
from pseudolidar.mapping.keyframes import Keyframes
from pseudolidar.mapping.path import Hung
from pseudolidar.mapping.registration import covariance, inliers, registered
from pseudolidar.mapping.second_motion import Expected
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose, Trajectory

# A frame becomes the next keyframe when fewer than this share of the points agree that did in the
# keyframe's first motion, or so many frames after it.
KEPT_SHARE, LONGEST_FRAMES = 0.6, 10
# A motion of whose direction or length less is known, m, is none: all that is seen is too far.
MOST_UNSURE_M = 0.5
# Six numbers of a motion need so many points at least.
FEWEST_POINTS = 6


@dataclass(frozen=True)
class VisualOdometry:
    """Stereo visual odometry: pairs chained by what they show.

    Args:
        least_inliers: points that must agree on a motion; with fewer the frame is lost.
        reach: frames that may be lost in a row; a motion bridges them. After more a new piece of
            path begins.
        offset: whether the disparity offset is looked for, where the rig has no correction.
    """

    least_inliers: int = 30
    reach: int = 5
    offset: bool = True

    def start(self, rig: StereoRig) -> VisualChain:
        """Begin with the cameras of all frames to come.

        Raises:
            UsageError: numbers that mean nothing.
        """
        if self.least_inliers < FEWEST_POINTS or self.reach < 1:
            raise UsageError(
                f"least_inliers {self.least_inliers}, reach {self.reach}",
                want=f"at least {FEWEST_POINTS} points and 1 frame",
            )
        return VisualChain(self, rig)


class VisualChain:
    """Follows the camera; give it the frames in order.

    Args:
        settings: as declared.
        rig: rectified; the correction it has is used.
    """

    def __init__(self, settings: VisualOdometry, rig: StereoRig) -> None:
        self._settings, self._rig = settings, rig
        self._estimate = OffsetEstimate(rig) if settings.offset and not rig.correction else None
        self._registered = 0
        self._time_ns: int | None = None
        self._pieces: list[Keyframes] = []
        self._last: _Last | None = None
        self._lost, self._most_agreed = 0, 0

    @property
    def offset(self) -> Offset:
        """What is known of the rig's disparity offset by now."""
        if self._estimate:
            return self._estimate.now
        return Offset(sigma_px=self._rig.systematic_sigma_px)

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now: for the rig, and for every cloud."""
        return self.offset.correction(self._rig) if self._estimate else self._rig.correction

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses `T_odom_camera` of all frames that were not lost, one trajectory for each piece.

        Early ones are put right with what is known of the offset by now: better than what
        `register` could tell at their time. With their covariances.
        """
        return tuple(piece.path.trajectory(self.offset) for piece in self._pieces)

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> OdometryState:
        """Where the next frame was taken.

        Args:
            frame: of the same rig as all.
            disparity: of its left image, as matched: no correction taken off.
            movable: things in its left image that may move by themselves; they are not looked at.

        Raises:
            CalibrationSizeMismatch: the frame has another size than the rig.
            StructureError: the disparities or a mask have another size than the frame.
            SequenceTime: the frame is not later than the one before.
        """
        state = self._placed(frame, disparity, movable)
        if self._estimate is None:
            return state
        return replace(state, offset_px=(self.offset.offset_px, self.offset.sigma_px))

    def _placed(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection]
    ) -> OdometryState:
        sight = self._sight(frame, disparity, movable)
        self._check_time(frame)
        self._registered += 1
        if self._last is None or self._lost > self._settings.reach:
            return self._begin(sight, frame.timestamp_ns)
        found = self._found(sight, frame.timestamp_ns)
        if isinstance(found, RelativePose):
            return self._go_on(sight, frame.timestamp_ns, found)
        return self._lose(found)

    def _check_time(self, frame: StereoFrame) -> None:
        if self._time_ns is not None and frame.timestamp_ns <= self._time_ns:
            raise SequenceTime(
                f"a frame at {frame.timestamp_ns} ns after one at {self._time_ns} ns",
                want="frames in order of time",
                where=f"frame {frame.id}",
            )
        self._time_ns = frame.timestamp_ns

    def _lose(self, why: str) -> OdometryState:
        self._lost += 1
        return OdometryState("lost", piece=max(0, len(self._pieces) - 1), why=why)

    def _sight(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection]
    ) -> Sight:
        height, width = frame.left.shape[:2]
        self._rig.check_size(width, height)
        masks = [one.mask for one in movable if one.mask is not None]
        for what, shape in (
            ("disparities", disparity.values.shape),
            *(("a mask", mask.shape) for mask in masks),
        ):
            if shape != (height, width):
                raise StructureError(
                    f"{what} of shape {shape}", want=f"{(height, width)}", where=f"frame {frame.id}"
                )
        covered = movable_pixels(movable, (height, width))
        return Sight(self._registered, MatchedPair.of(frame, disparity), covered)

    def _begin(self, sight: Sight, timestamp_ns: int) -> OdometryState:
        """A piece of path from this frame on, if it shows enough."""
        keyframe = Keyframe.of(sight, self._rig)
        least = self._settings.least_inliers
        blind = sight.blind
        if blind or len(keyframe.seeds) < least:
            why = blind or f"{len(keyframe.seeds)} corners that both eyes see, want {least}"
            return self._lose(why)
        piece = Keyframes(keyframe, self._rig, self.offset, least_inliers=least)
        self._pieces.append(piece)
        self._lost, self._most_agreed = 0, 0
        hung = Hung.itself(self.offset)
        piece.path.add_frame(timestamp_ns, hung)
        self._last = _Last(sight, timestamp_ns, np.eye(4), hung)
        return OdometryState(
            "first",
            Pose.identity(ODOM, self._rig.left.frame),
            covariance=np.zeros((6, 6)),
            piece=len(self._pieces) - 1,
            keyframe=True,
        )

    def _found(self, sight: Sight, timestamp_ns: int) -> RelativePose | str:
        """The motion from the newest keyframe, or why there is none."""
        last = self._before
        blind = sight.blind or sight.frozen_since(last.sight)
        if blind:
            return blind
        expected = self._expected(timestamp_ns)
        guess = None if expected is None else expected.T_to_from
        found = self._tried(sight, guess, expected)
        if isinstance(found, str) and guess is not None:
            found = self._tried(sight, None, expected)
        if isinstance(found, str) and last.sight is not self._pieces[-1].newest.sight:
            # The keyframe may be too far behind: the last frame becomes one.
            self._add_keyframe(last.sight, last.hung)
            self._last = replace(last, hung=Hung.itself(self.offset))
            found = self._tried(sight, None, self._expected(timestamp_ns))
        return found

    def _expected(self, timestamp_ns: int) -> Expected | None:
        """The motion from the newest keyframe, if the camera goes on as before; None if unknown."""
        on = self._before.further(timestamp_ns)
        if on is None:
            return None
        seconds = (timestamp_ns - self._before.timestamp_ns) / NS_PER_S
        return Expected(inverted(on) @ self._pieces[-1].T_odom_newest, seconds)

    @property
    def _before(self) -> _Last:
        assert self._last is not None  # asked for once a piece has begun
        return self._last

    def _tried(
        self, sight: Sight, guess: Float64 | None, expected: Expected | None
    ) -> RelativePose | str:
        """The camera's motion, looked for near a guess, or why it is none."""
        newest, correction = self._pieces[-1].newest, self.correction
        motion = registered(newest, sight, self._rig, guess, correction, expected=expected)
        least = self._settings.least_inliers
        if motion is None:
            return f"too few points agree on a motion, {least} are wanted"
        agree = inliers(motion)
        if agree < least:
            return f"{agree} points agree on a motion, {least} are wanted"
        off_m = unsure_m(covariance(motion))
        if off_m > MOST_UNSURE_M:
            return f"a motion known to {off_m:.1f} m only: all that is seen is too far away"
        return motion

    def _go_on(self, sight: Sight, timestamp_ns: int, motion: RelativePose) -> OdometryState:
        """The frame at the newest keyframe, or as the next one."""
        piece, offset = self._pieces[-1], self.offset
        shift = by_offset(unscaled(motion, offset), self._rig, offset)
        hung = Hung.of(motion.T_to_from, covariance(motion), shift, offset)
        doubt = piece.doubt.after(hung)
        gap = sight.number - piece.newest.sight.number
        keyframe = self._is_next_key(gap, inliers(motion))
        if keyframe:
            if self._estimate:
                self._estimate.add(motion, piece.newest.seeds)
            self._add_keyframe(sight, hung)
            T_odom = piece.T_odom_newest
            hung_now = Hung.itself(offset)
        else:
            T_odom = piece.T_odom_newest @ hung.T_key_frame
            hung_now = hung
        piece.path.add_frame(timestamp_ns, hung_now)
        step = self._step(T_odom, hung, self._before)
        seconds = (timestamp_ns - self._before.timestamp_ns) / NS_PER_S
        twist_per_s = log_twist(step.T_from_to) / seconds
        self._last = _Last(sight, timestamp_ns, T_odom, hung_now, twist_per_s)
        self._lost = 0
        return OdometryState(
            "ok",
            Pose(ODOM, self._rig.left.frame, T_odom),
            step=step,
            covariance=doubt.total(self.offset),
            piece=len(self._pieces) - 1,
            tracks=motion.tracks,
            weights=motion.weights,
            keyframe_gap=gap,
            keyframe=keyframe,
        )

    def _step(self, T_odom: Float64, hung: Hung, last: _Last) -> CameraStep:
        """From the last frame; both hang at the same keyframe, and their errors add up."""
        T_last_now = inverted(last.T_odom_camera) @ T_odom
        doubt = carried(last.hung.covariance, T_last_now) + hung.covariance
        by_offset = hung.by_offset - adjoint(inverted(T_last_now)) @ last.hung.by_offset
        return CameraStep(T_last_now, doubt, frames=self._lost + 1, by_offset=by_offset)

    def _is_next_key(self, gap: int, agree: int) -> bool:
        """Whether the newest keyframe, so many frames back, has done its work."""
        self._most_agreed = max(self._most_agreed, agree)
        return agree < KEPT_SHARE * self._most_agreed or gap >= LONGEST_FRAMES

    def _add_keyframe(self, sight: Sight, hung: Hung) -> None:
        self._pieces[-1].add(Keyframe.of(sight, self._rig), hung, self.correction)
        self._most_agreed = 0


@dataclass(frozen=True, eq=False)
class _Last:
    """The last frame that was not lost.

    Args:
        sight: what it shows.
        timestamp_ns: when it was taken.
        T_odom_camera: (4, 4) its pose.
        hung: at the newest keyframe.
        twist_per_s: (6,) how the camera moved to it; None of the first of a piece.
    """

    sight: Sight
    timestamp_ns: int
    T_odom_camera: Float64
    hung: Hung
    twist_per_s: Float64 | None = None

    def further(self, timestamp_ns: int) -> Float64 | None:
        """(4, 4) pose at a later time, if the camera goes on as before; None if unknown."""
        if self.twist_per_s is None:
            return None
        seconds = (timestamp_ns - self.timestamp_ns) / NS_PER_S
        return gone_on(self.T_odom_camera, self.twist_per_s, seconds)
