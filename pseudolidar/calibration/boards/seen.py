"""What both eyes see of a board in one pair of pictures."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.capture import is_sharp
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.find import find_board
from pseudolidar.geometry.grey import grey8_of
from pseudolidar.structures.arrays import Image, size_of


@dataclass(frozen=True, eq=False)
class BoardSeen:
    """A board in a pair of pictures.

    Args:
        id: name of the pair.
        left: what the left eye sees of it, None where it is not found.
        right: the same of the right one.
        sizes_px: (width, height) of both pictures.
        sharp: whether each eye sees it sharp.
    """

    id: str
    left: Corners | None
    right: Corners | None
    sizes_px: tuple[tuple[int, int], tuple[int, int]]
    sharp: tuple[bool, bool] = (True, True)

    @property
    def eyes(self) -> tuple[Corners | None, Corners | None]:
        """What the left and the right eye see."""
        return self.left, self.right


@dataclass(frozen=True)
class FindInPair:
    """Looks for a board in pairs of pictures.

    Args:
        board: which one.
        thorough: take the time to look in several ways.
    """

    board: Board
    thorough: bool = True

    def __call__(self, left: Image, right: Image, name: str) -> BoardSeen:
        """What is seen in a pair."""
        greys = grey8_of(left), grey8_of(right)
        found = [find_board(grey, self.board, thorough=self.thorough) for grey in greys]
        points_m = self.board.points_m
        sharp = [
            corners is not None and is_sharp(grey, corners, points_m)
            for grey, corners in zip(greys, found, strict=True)
        ]
        sizes_px = size_of(greys[0]), size_of(greys[1])
        return BoardSeen(name, found[0], found[1], sizes_px, (sharp[0], sharp[1]))
