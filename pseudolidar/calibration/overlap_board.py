"""A board that pairs of a body see at the same moment: corners with their places in each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pseudolidar.calibration.boards.board import Board, BoardName, Dictionary
from pseudolidar.calibration.boards.find import find_board
from pseudolidar.calibration.overlap_partners import Between, Partners
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.geometry.triangulation import points_by_p
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

# Errors of corners in pictures, px (68 %): of their disparity, and across.
DISPARITY_SIGMA_PX, ACROSS_SIGMA_PX = 0.2, 0.15
# Corners of less disparity are too far to be of use, px; corners of more rows apart are no pair.
LEAST_DISPARITY_PX, MOST_ROWS_PX = 0.5, 3.0
# Flatness of boards, m: no corner is surer than this.
FLOOR_M = 0.0005


@dataclass(frozen=True)
class SharedBoard:
    """From a board that neighbouring pairs see at the same moment.

    Args:
        board: kind and counts, as `calibrate` takes them. Boards with markers (`charuco:8x6`) may
            reach out of a picture; a chessboard must be seen whole by both pairs.
        square: side of a square, m.
        marker: side of a ChArUco marker, m.
        dictionary: of the markers.
        least_matches: corners that must be seen by another pair as well, all frames together.
    """

    board: BoardName = BoardName("charuco", 8, 6)
    square: float = 0.0
    marker: float | None = None
    dictionary: Dictionary | None = None
    least_matches: int = 40

    gates_m: ClassVar[tuple[float, ...]] = (np.inf,)

    @property
    def pattern(self) -> Board:
        """The board.

        Raises:
            UsageError: sizes that cannot be.
        """
        return Board.of(self.board, self.square, marker_m=self.marker, dictionary=self.dictionary)


@dataclass(frozen=True, eq=False)
class BoardSight:
    """Corners of the board as one pair sees them in one frame, in its left camera's frame.

    Args:
        ids: (N,) int64, which corners.
        xyz: (N, 3) float64 m.
        sigma_m: (N,) standard deviations along the rays.
        across_m: (N,) across them.
    """

    ids: Int64
    xyz: Float64
    sigma_m: Float64
    across_m: Float64

    @classmethod
    def of(cls, frame: StereoFrame, board: Board) -> BoardSight | None:
        """Corners that both eyes of a rectified pair see; None where they do not."""
        greys = grey8_pair(frame.left, frame.right)
        left, right = (find_board(grey, board) for grey in greys)
        if left is None or right is None:
            return None
        best: BoardSight | None = None
        for turn in board.turns():
            sight = cls._triangulated(frame, left.ids, left.uv, turn[right.ids], right.uv)
            if best is None or len(sight.ids) > len(best.ids):
                best = sight
        return best if best is not None and len(best.ids) else None

    @classmethod
    def _triangulated(
        cls, frame: StereoFrame, ids: Int64, uv: Float64, ids_right: Int64, uv_right: Float64
    ) -> BoardSight:
        """Corners that are ahead of both eyes, and in one row."""
        rig = frame.rig
        common, at, at_right = np.intersect1d(ids, ids_right, return_indices=True)
        u, v = uv[at].T
        u_right, v_right = uv_right[at_right].T
        d = u - u_right
        ahead = (d + rig.doffs_px > LEAST_DISPARITY_PX) & (np.abs(v - v_right) < MOST_ROWS_PX)
        xyz = points_by_p(d[ahead], u[ahead], v[ahead], rig)
        length_m = np.linalg.norm(xyz, axis=1)
        along_m = xyz[:, 2] * length_m / rig.fB_px_m * DISPARITY_SIGMA_PX
        return cls(
            common[ahead].astype(np.int64), xyz, along_m,
            xyz[:, 2] / rig.left.focal_px * ACROSS_SIGMA_PX,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def covariance_m2(self) -> Float64:
        """(N, 3, 3) covariance of each corner, m^2."""
        rays = self.xyz / np.linalg.norm(self.xyz, axis=1)[:, None]
        outer = rays[:, :, None] * rays[:, None, :]
        along, across = (self.sigma_m**2)[:, None, None], (self.across_m**2)[:, None, None]
        return np.asarray(outer * along + (np.eye(3) - outer) * across)

    def partners(self, other: BoardSight, between: Between, gate_m: float) -> Partners:  # noqa: ARG002
        """Corners that both see, along each axis of the body.

        Args:
            other: what another pair sees in the same frame.
            between: the two pairs; this sight is of the first.
            gate_m: not needed: corners have numbers.
        """
        _, mine, theirs = np.intersect1d(self.ids, other.ids, return_indices=True)
        T_body_own, T_body_other = between.T_body_first, between.T_body_second
        points = T_body_own.apply(self.xyz[mine])
        return Partners(
            between.first,
            between.second,
            np.repeat(points, 3, axis=0),
            np.tile(np.eye(3), (len(mine), 1)),
            (points - T_body_other.apply(other.xyz[theirs])).ravel(),
            self.spread_m(mine, T_body_own).ravel(),
            other.spread_m(theirs, T_body_other).ravel(),
            FLOOR_M,
            3,
        )

    def spread_m(self, corners: Int64, T_body_left: Pose) -> Float64:
        """(N, 3) standard deviations of some corners along the axes of the body, m."""
        R = T_body_left.matrix[:3, :3]
        squares = np.einsum("ij,njk,ik->ni", R, self.covariance_m2[corners], R)
        return np.asarray(np.sqrt(squares))


def read_alike(
    frame: Mapping[str, BoardSight], places: Mapping[str, Pose], board: Board
) -> dict[str, BoardSight]:
    """The corners of a frame with one numbering: a chessboard can be read from both ends.

    Args:
        frame: what the pairs see.
        places: `T_base_link_left` of each, right to some degrees.
        board: which one.
    """
    names = list(frame)
    alike = {names[0]: frame[names[0]]} if names else {}
    for name in names[1:]:
        first = alike[names[0]]
        numberings = [turn[frame[name].ids] for turn in board.turns()]
        apart = [
            _apart_m(first, places[names[0]], ids, frame[name].xyz, places[name])
            for ids in numberings
        ]
        sight = frame[name]
        ids = numberings[int(np.argmin(apart))]
        alike[name] = BoardSight(ids, sight.xyz, sight.sigma_m, sight.across_m)
    return alike


def _apart_m(first: BoardSight, place: Pose, ids: Int64, xyz: Float64, other: Pose) -> float:
    _, at, at_other = np.intersect1d(first.ids, ids, return_indices=True)
    if not len(at):
        return np.inf
    apart = place.apply(first.xyz[at]) - other.apply(xyz[at_other])
    return float(np.median(np.linalg.norm(apart, axis=1)))
