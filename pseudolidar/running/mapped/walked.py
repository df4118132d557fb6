"""The path as it is known at the end: its frames, its pieces, its loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from pseudolidar.errors import OdometryLost
from pseudolidar.mapping.registered import Registered, Sensors
from pseudolidar.mapping.scan_counts import ScanCounts
from pseudolidar.structures.arrays import Bool, Float64, Int64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.loop import LoopClosure
from pseudolidar.structures.odometry import MEASURED, OdometryStatus
from pseudolidar.structures.pose import Trajectory


@dataclass(frozen=True, eq=False)
class Placed:
    """A frame on its way.

    Args:
        id: the source's name of it.
        index: place in the source.
        timestamp_ns: when it was taken.
        status: `first` of a piece of path, `ok`, `extrapolated`, `lost`.
        why: what was missing, where nothing was measured of it, or vision saw nothing.
        piece: of the path.
        tracks: points that were followed.
        inliers: how many of them agree.
        wrong: vision's step was found to be wrong, and another taken.
        T_map_camera: (4, 4) ground truth of the left camera, where the source knows it.
        movable: things in its left image that may move by themselves, as boxes.
        ended: of the frame with which a piece of path was given up.
        sensors: by which its pose was measured.
        offset_px: by how much disparities are too large, and how sure that was, as known by then;
            None where it is not looked for.
    """

    id: str
    index: int
    timestamp_ns: int
    status: OdometryStatus
    why: str
    piece: int
    tracks: int
    inliers: int
    wrong: bool
    T_map_camera: Float64 | None
    movable: tuple[Detection, ...] = ()
    ended: OdometryLost | None = None
    sensors: Sensors = "none"
    offset_px: tuple[float, float] | None = None

    @classmethod
    def of(
        cls,
        frame: StereoFrame,
        registered: Registered,
        T_map_camera: Float64 | None,
        movable: Sequence[Detection],
    ) -> Self:
        """A frame as odometry told of it, without its pictures: memory must not grow by them."""
        state, check = registered.state, registered.check
        return cls(
            frame.id,
            frame.index,
            frame.timestamp_ns,
            status=state.status,
            why=state.why,
            piece=state.piece,
            tracks=state.n_tracks,
            inliers=state.inliers,
            wrong=check is not None and check.wrong,
            T_map_camera=T_map_camera,
            movable=tuple(replace(one, mask=None) for one in movable),
            ended=state.ended,
            sensors=registered.sensors,
            offset_px=state.offset_px,
        )

    @property
    def lost(self) -> bool:
        """Whether nobody knows where it was taken."""
        return self.status == "lost"

    @property
    def measured(self) -> bool:
        """Whether something was seen of how it moved, or a piece of path begins here."""
        return self.status in MEASURED

    @property
    def extrapolated(self) -> bool:
        """Whether nothing was, and yet it has a pose."""
        return self.status == "extrapolated"

    @property
    def blind(self) -> bool:
        """Whether a scan alone says where it was taken, because vision lost it."""
        return self.sensors == "scan" and bool(self.why)

    def settled(self, *, between: bool) -> Self:
        """As it is in the end: extrapolated between frames that were measured, or else lost."""
        if self.measured:
            return self
        if between:
            return replace(self, status="extrapolated")
        withdrawn = "; the pose that was extrapolated is withdrawn"
        return replace(self, status="lost", why=self.why + withdrawn * self.extrapolated)


@dataclass(frozen=True, eq=False)
class Walked:
    """A path with its loops.

    Args:
        pieces: whose poses have nothing in common, the longest first.
        placed: every frame, in order, as it is in the end.
        loops: that the path keeps.
        dropped: loops that disagree with all the rest.
        refused: how many candidates were none, by reason.
        scans: what was odd about scans; None where they were not looked at.
    """

    pieces: tuple[Piece, ...]
    placed: tuple[Placed, ...] = ()
    loops: tuple[LoopClosure, ...] = ()
    dropped: tuple[LoopClosure, ...] = ()
    refused: Mapping[str, int] = field(default_factory=dict)
    scans: ScanCounts | None = None

    @property
    def names(self) -> Mapping[int, str]:
        """Ids of frames by their index."""
        return {one.index: one.id for one in self.placed}

    @property
    def ended(self) -> tuple[OdometryLost, ...]:
        """Where and why pieces of path were given up."""
        return tuple(one.ended for one in self.placed if one.ended is not None)


@dataclass(frozen=True, eq=False)
class Piece:
    """Frames whose poses are known relative to one another.

    Args:
        frames: in order of time; some may be extrapolated, the ends never.
        T_odom_camera: (N, 4, 4) of their left cameras, in that of the first.
        covariance: (N, 6, 6) of twists on their right; loops are not in it.
    """

    frames: tuple[Placed, ...]
    T_odom_camera: Float64
    covariance: Float64

    @classmethod
    def of(cls, frames: tuple[Placed, ...], parts: Sequence[Trajectory]) -> Self:
        """Of parts with covariances whose poses have something in common."""
        poses = np.concatenate([part.T_world_body for part in parts])
        return cls(frames, poses, np.concatenate([part.doubts for part in parts]))

    @property
    def measured(self) -> Bool:
        """(N,) which of the frames are not extrapolated."""
        return np.array([one.measured for one in self.frames], np.bool_)

    @property
    def joined(self) -> bool:
        """Whether loops made it of several."""
        return len({one.piece for one in self.frames}) > 1

    @property
    def times_ns(self) -> Int64:
        """(N,) int64."""
        return np.array([one.timestamp_ns for one in self.frames], np.int64)

    @property
    def length_m(self) -> float:
        """Way of the camera."""
        steps = np.diff(self.T_odom_camera[:, :3, 3], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    @property
    def truth(self) -> Float64 | None:
        """(N, 4, 4) of the same frames as the source knows them; None unless it knows them all."""
        known = [one.T_map_camera for one in self.frames if one.T_map_camera is not None]
        return np.stack(known) if known and len(known) == len(self.frames) else None
