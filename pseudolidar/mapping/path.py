"""Poses along a piece of path, put right once more is known of the rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.geometry.twists import adjoint, carried, exp_twist, inverted
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import Trajectory


@dataclass(frozen=True, eq=False)
class Hung:
    """A frame that hangs at a keyframe.

    Args:
        T_key_frame: (4, 4) its pose in the keyframe.
        covariance: (6, 6) of a twist on its right, without that of the offset.
        by_offset: (6,) per px: twist on its right that more offset makes, scale included.
        offset: that was taken off when it was found.
        unscaled_by_offset: (6,) per px: twist on the left of its inverse, without depth factor.
    """

    T_key_frame: Float64
    covariance: Float64
    by_offset: Float64
    offset: Offset
    unscaled_by_offset: Float64

    @classmethod
    def itself(cls, offset: Offset) -> Hung:
        """A keyframe at itself."""
        return cls(np.eye(4), np.zeros((6, 6)), np.zeros(6), offset, np.zeros(6))

    @classmethod
    def of(
        cls, T_to_from: Float64, covariance: Float64, unscaled_by_offset: Float64, offset: Offset
    ) -> Hung:
        """From a motion that was found with `offset` taken off.

        Args:
            T_to_from: (4, 4) maps points of the keyframe to the frame.
            covariance: (6, 6) of a twist on its left, which is that of one on its inverse's right.
            unscaled_by_offset: (6,) as stored.
            offset: known then.
        """
        scale = offset.factor_by_offset / offset.depth_factor
        by_scale = np.concatenate([T_to_from[:3, 3] * scale, np.zeros(3)])
        by_offset = -(unscaled_by_offset + by_scale)
        T = inverted(T_to_from)
        return cls(T, covariance, by_offset, offset, unscaled_by_offset)

    def with_offset(self, offset: Offset) -> Float64:
        """(4, 4) `T_key_frame` as it would have been found with another offset."""
        T = inverted(self.T_key_frame)
        T[:3, 3] /= self.offset.depth_factor
        T = exp_twist(self.unscaled_by_offset * (offset.offset_px - self.offset.offset_px)) @ T
        T[:3, 3] *= offset.depth_factor
        return inverted(T)


@dataclass(frozen=True, eq=False)
class Doubt:
    """How unsure a pose is.

    Args:
        covariance: (6, 6) of a twist on its right, of errors that each motion makes anew.
        by_offset: (6,) per px of offset, which all motions share.
    """

    covariance: Float64
    by_offset: Float64

    @classmethod
    def none(cls) -> Doubt:
        """Of where a path begins."""
        return cls(np.zeros((6, 6)), np.zeros(6))

    def after(self, hung: Hung) -> Doubt:
        """Of a frame that hangs at the pose."""
        return self.after_step(hung.T_key_frame, hung.covariance, hung.by_offset)

    def after_step(self, T_from_to: Float64, covariance: Float64, by_offset: Float64) -> Doubt:
        """Of the pose after a step (4, 4) whose own doubt is (6, 6) and (6,) per px."""
        return Doubt(
            carried(self.covariance, T_from_to) + covariance,
            adjoint(inverted(T_from_to)) @ self.by_offset + by_offset,
        )

    def total(self, offset: Offset) -> Float64:
        """(6, 6) of both together."""
        return self.covariance + np.outer(self.by_offset, self.by_offset) * offset.sigma_px**2


class Path:
    """A piece of path as keyframes, each hung at the one before, and the frames at them."""

    def __init__(self) -> None:
        self._keys: list[Hung] = []
        self._frames: list[tuple[int, int, Hung]] = []

    @property
    def last_key(self) -> int:
        """Number of the latest keyframe."""
        return len(self._keys) - 1

    def add_key(self, hung: Hung) -> None:
        """The next keyframe, at the one before; the first at itself."""
        self._keys.append(hung)

    def move_key(self, key: int, T_key_before: Float64) -> None:
        """The pose of a keyframe in the one before, as later motions agree on it."""
        self._keys[key] = replace(self._keys[key], T_key_frame=T_key_before)

    def add_frame(self, timestamp_ns: int, hung: Hung) -> None:
        """A frame at the latest keyframe."""
        self._frames.append((timestamp_ns, self.last_key, hung))

    def trajectory(self, offset: Offset) -> Trajectory:
        """All poses `T_odom_camera`, as they would have been found with this offset."""
        keys, doubts = [np.eye(4)], [Doubt.none()]
        for hung in self._keys[1:]:
            keys.append(keys[-1] @ hung.with_offset(offset))
            doubts.append(doubts[-1].after(hung))
        poses = [keys[key] @ hung.with_offset(offset) for _, key, hung in self._frames]
        covariances = [doubts[key].after(hung).total(offset) for _, key, hung in self._frames]
        return stacked([time_ns for time_ns, _, _ in self._frames], poses, covariances)


def stacked(
    timestamps_ns: Sequence[int],
    poses: Sequence[Float64],
    covariances: Sequence[Float64],
) -> Trajectory:
    """Poses (4, 4) and covariances (6, 6) of a piece of path, as many as there are."""
    return Trajectory(
        np.asarray(timestamps_ns, np.int64),
        np.array(poses, np.float64).reshape(-1, 4, 4),
        np.array(covariances, np.float64).reshape(-1, 6, 6),
    )
