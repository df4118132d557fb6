"""The first pass: where each frame was taken, told in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.mapping.loops import LoopSearch
from pseudolidar.mapping.pose_graph import closed
from pseudolidar.mapping.registered import OdometryChain, Registered
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.loop import LoopClosure


@dataclass(frozen=True, eq=False)
class Placed:
    """A frame on its way.

    Args:
        id: the source's name of it.
        index: place in the source.
        timestamp_ns: when it was taken.
        status: `first` of a piece of path, `ok`, `lost`.
        why: what was missing, where it is lost.
        piece: of the path.
        tracks: points that were followed.
        inliers: how many of them agree.
        wrong: vision's step was found to be wrong, and another taken.
        T_map_camera: (4, 4) ground truth of the left camera, where the source knows it.
        movable: things in its left image that may move by themselves, as boxes.
    """

    id: str
    index: int
    timestamp_ns: int
    status: str
    why: str
    piece: int
    tracks: int
    inliers: int
    wrong: bool
    T_map_camera: Float64 | None
    movable: tuple[Detection, ...] = ()

    @property
    def lost(self) -> bool:
        """Whether nobody knows where it was taken."""
        return self.status == "lost"


class Walk:
    """Goes along the frames and remembers what was told of each.

    Args:
        chain: begun.
        rig: of all frames.
        loops: begun; None where returns are not looked for.
    """

    def __init__(
        self, chain: OdometryChain, rig: StereoRig, loops: LoopSearch | None = None
    ) -> None:
        self._chain, self._T_base_left = chain, left_in_base_link(rig).matrix
        self._loops, self._found = loops, list[LoopClosure]()
        self.placed: list[Placed] = []

    def step(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection]
    ) -> Registered:
        """Where the next frame was taken.

        Raises:
            SequenceTime: it is not later than the one before.
            ScanMissing: KISS-ICP alone was asked for, and it has no scan.
        """
        registered = self._chain.register(frame, disparity, movable)
        state, check = registered.state, registered.check
        truth = None if frame.pose is None else frame.pose.matrix @ self._T_base_left
        self.placed.append(
            Placed(
                frame.id,
                frame.index,
                frame.timestamp_ns,
                state.status,
                state.why,
                state.piece,
                state.n_tracks,
                state.inliers,
                check is not None and check.wrong,
                truth,
                # Of masks the boxes are kept: memory must not grow by a picture a frame.
                tuple(replace(one, mask=None) for one in movable),
            )
        )
        pose = state.T_odom_camera
        if self._loops is not None and pose and self._loops.wants(pose.matrix, state.piece):
            self._found += self._loops.add(
                frame.index,
                frame,
                disparity,
                pose.matrix,
                piece=state.piece,
                movable=tuple(movable),
                correction=self.correction,
            )
        return registered

    @property
    def whole(self) -> bool:
        """Whether all that is remembered of places can be read."""
        return self._loops is None or self._loops.whole

    @property
    def correction(self) -> DisparityCorrection | None:
        """What the motion told of the rig."""
        return self._chain.correction

    def walked(self) -> Walked:
        """The path, by all that is known at the end, with its loops closed.

        Raises:
            MissingDependency: there are loops, and open3d is absent.
        """
        path = closed(self._chain.trajectories(), self._found)
        pieces = []
        for number in sorted(set(path.maps)):
            joined = [i for i, one in enumerate(path.maps) if one == number]
            frames = tuple(one for one in self.placed if one.piece in joined and not one.lost)
            poses = np.concatenate([path.trajectories[i].T_world_body for i in joined])
            if len(frames) == len(poses):
                pieces.append(Piece(frames, poses))
        longest_first = tuple(sorted(pieces, key=lambda piece: -len(piece.frames)))
        told = {} if self._loops is None else self._loops.refused
        refused = {str(why): count for why, count in told.items() if count}
        names = {one.index: one.id for one in self.placed}
        return Walked(longest_first, path.used, path.dropped, refused, names)


@dataclass(frozen=True, eq=False)
class Walked:
    """A path with its loops.

    Args:
        pieces: whose poses have nothing in common, the longest first.
        loops: that the path keeps.
        dropped: loops that disagree with all the rest.
        refused: how many candidates were none, by reason.
        names: ids of frames by their index.
    """

    pieces: tuple[Piece, ...]
    loops: tuple[LoopClosure, ...] = ()
    dropped: tuple[LoopClosure, ...] = ()
    refused: Mapping[str, int] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Piece:
    """Frames whose poses are known relative to one another.

    Args:
        frames: in order of time.
        T_odom_camera: (N, 4, 4) of their left cameras, in that of the first.
    """

    frames: tuple[Placed, ...]
    T_odom_camera: Float64

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
