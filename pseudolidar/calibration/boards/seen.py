"""What both eyes see of a board in one pair of pictures."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.calibration.boards.board import Board
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
    """

    id: str
    left: Corners | None
    right: Corners | None
    sizes_px: tuple[tuple[int, int], tuple[int, int]]


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
        return BoardSeen(name, found[0], found[1], (size_of(greys[0]), size_of(greys[1])))
