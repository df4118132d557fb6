"""Which of two cameras stands on the left, by how both see a board: nobody need know their lenses.

Where the right camera stands, seen from the left one, follows up to small errors with any likely
focal length: a wrong one scales the scene along the axis, and turned cameras are turned back first.
So toed-in cameras are told right. What cannot be told is told so: a view is a vote, and several
must agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.seen import BoardSeen
from pseudolidar.structures.arrays import Float64, Int64

EyeOrder = Literal["right", "exchanged", "unknown"]
# Focal length that is assumed, in picture widths: a view of 58 degrees.
FOCAL_WIDTHS = 0.9
# The right camera must stand this much to one side: its share of the baseline. Of 83 views of three
# real rigs 78 reach it, and all of them are right; the others say nothing.
LEAST_SHARE = 0.85
# Cameras turned by more than this against one another are read wrong, degrees.
MOST_TURNED_DEG = 30.0
# Corners that tell how a board stands.
LEAST_CORNERS = 12
# Votes by which one order must be ahead of the other.
LEAD = 2


def eye_order(seen: BoardSeen, board: Board) -> EyeOrder:
    """Which camera is the left one, by one pair of pictures.

    Args:
        seen: the board in both; the right one may be read from its other end.
        board: which.
    """
    if seen.left is None or seen.right is None:
        return "unknown"
    first = _pose(seen.left.ids, seen.left.uv, board, seen.sizes_px[0])
    for turn in board.turns():
        other = _pose(turn[seen.right.ids], seen.right.uv, board, seen.sizes_px[1])
        if first is None or other is None:
            return "unknown"
        order = _order(other @ np.linalg.inv(first))
        if order != "unknown":
            return order
    return "unknown"


@dataclass
class EyeVotes:
    """What pairs have said so far.

    Args:
        right: votes for cameras that are named right.
        exchanged: votes for exchanged ones.
    """

    right: int = 0
    exchanged: int = 0

    def add(self, order: EyeOrder) -> None:
        """One pair's vote."""
        self.right += order == "right"
        self.exchanged += order == "exchanged"

    @property
    def order(self) -> EyeOrder:
        """What they say together."""
        if self.exchanged - self.right >= LEAD:
            return "exchanged"
        return "right" if self.right - self.exchanged >= LEAD else "unknown"


def _order(T_right_left: Float64) -> EyeOrder:
    R, t = T_right_left[:3, :3], T_right_left[:3, 3]
    turned_deg = np.degrees(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))
    centre = -R.T @ t  # of the right camera, in the left one's axes
    length = float(np.linalg.norm(centre))
    if turned_deg > MOST_TURNED_DEG or not length > 0:
        return "unknown"
    share = float(centre[0]) / length
    if abs(share) < LEAST_SHARE:
        return "unknown"
    return "right" if share > 0 else "exchanged"


def _pose(ids: Int64, uv: Float64, board: Board, size_px: tuple[int, int]) -> Float64 | None:
    """(4, 4) from the board to a camera; None where its corners do not tell."""
    import cv2

    if len(ids) < LEAST_CORNERS:
        return None
    done, turn, shift = cv2.solvePnP(
        board.points_m[ids], uv, _assumed(size_px), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not done:
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
    return T


def _assumed(size_px: tuple[int, int]) -> Float64:
    width, height = size_px
    focal_px = FOCAL_WIDTHS * width
    return np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1.0]])
