"""The first pass: where each frame was taken, told in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.errors import OdometryLost
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.mapping.bridges import bridged
from pseudolidar.mapping.loops import LoopSearch
from pseudolidar.mapping.pose_graph import closed
from pseudolidar.mapping.registered import OdometryChain, Registered
from pseudolidar.running.mapped.walked import Piece, Placed, Walked
from pseudolidar.structures.arrays import Int64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.loop import LoopClosure
from pseudolidar.structures.pose import Trajectory


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
        state = registered.state
        truth = None if frame.pose is None else frame.pose.matrix @ self._T_base_left
        self.placed.append(Placed.of(frame, registered, truth, movable))
        pose = state.measured_pose
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
            OdometryLost: not one frame could be placed.
            MissingDependency: there are loops, and open3d is absent.
        """
        if self.placed and all(one.lost for one in self.placed):
            raise OdometryLost(
                f"none of {len(self.placed)} frames could be placed, the first one by this: "
                f"{self.placed[0].why}",
                want="a frame that a path can begin at",
                fix="Look at the pictures: `pseudolidar check` says what is wrong with pairs.",
                where=f"frame {self.placed[0].id}",
            )
        path = closed(self._chain.trajectories(), self._found)
        whole = [bridged(one, self._unmeasured_ns(i)) for i, one in enumerate(path.trajectories)]
        placed = self._settled(whole)
        pieces = []
        for number in sorted(set(path.maps)):
            joined = [i for i, one in enumerate(path.maps) if one == number]
            frames = tuple(one for one in placed if one.piece in joined and not one.lost)
            piece = Piece.of(frames, [whole[i] for i in joined])
            if len(frames) == len(piece.T_odom_camera):
                pieces.append(piece)
        longest_first = tuple(sorted(pieces, key=lambda piece: -len(piece.frames)))
        told = {} if self._loops is None else self._loops.refused
        refused = {str(why): count for why, count in told.items() if count}
        counts = self._chain.scan_counts
        scans = None if counts is None else replace(counts)  # as it is now
        return Walked(longest_first, placed, path.used, path.dropped, refused, scans)

    def _unmeasured_ns(self, piece: int) -> Int64:
        """Times of frames of a piece of path, or after it, of which nothing was measured."""
        frames = [one for one in self.placed if one.piece == piece and not one.measured]
        return np.array([one.timestamp_ns for one in frames], np.int64)

    def _settled(self, pieces: Sequence[Trajectory]) -> tuple[Placed, ...]:
        between = {
            (number, time_ns)
            for number, piece in enumerate(pieces)
            for time_ns in piece.timestamps_ns[piece.extrapolated].tolist()
        }
        return tuple(
            one.settled(between=(one.piece, one.timestamp_ns) in between) for one in self.placed
        )
