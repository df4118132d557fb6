"""A board of any kind in a picture."""

from __future__ import annotations

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.chessboard import find_chessboard
from pseudolidar.calibration.boards.circles import find_circles
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.markers import find_aprilgrid, find_charuco
from pseudolidar.structures.arrays import UInt8


def find_board(grey: UInt8, board: Board, *, thorough: bool = True) -> Corners | None:
    """Corners of the board in a picture, to a fraction of a pixel; None where it is not seen.

    Chessboards and circles are found only whole, boards with markers in parts, too.

    Args:
        grey: (H, W) the picture.
        board: which one.
        thorough: take the time to look in several ways; else, for films, in the quickest alone.
    """
    match board.name.kind:
        case "chessboard":
            return find_chessboard(grey, board, thorough=thorough)
        case "circles" | "acircles":
            return find_circles(grey, board, thorough=thorough)
        case "charuco":
            return find_charuco(grey, board)
        case "aprilgrid":
            return find_aprilgrid(grey, board)
