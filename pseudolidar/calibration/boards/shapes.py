"""What is black on a board: rectangles and circles in metres, whatever it is drawn with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.markers import april_ids, charuco_of, dictionary_of
from pseudolidar.formats.drawing.png import shaded
from pseudolidar.structures.arrays import Float64, UInt8

# Radius of circles: this share of `square`, which is the distance of circles, or of their rows.
RADIUS_SHARE, STAGGERED_RADIUS_SHARE = 0.3, 0.38


@dataclass(frozen=True, eq=False)
class Shapes:
    """A drawing of a board in the board's frame, m: x right, y down.

    Args:
        low_m: (2,) its top left corner.
        high_m: (2,) its bottom right corner.
        rectangles_m: (R, 4) x, y, width, height of what is black.
        circles_m: (C, 3) x, y, radius of what is black.
    """

    low_m: Float64
    high_m: Float64
    rectangles_m: Float64
    circles_m: Float64

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height."""
        width, height = (self.high_m - self.low_m).tolist()
        return width, height


def shapes_of(board: Board) -> Shapes:
    """What is black on a board."""
    match board.name.kind:
        case "chessboard":
            columns, rows = board.name.columns + 1, board.name.rows + 1
            return _ruled(_squares(columns, rows, board.square_m), columns, rows, board.square_m)
        case "charuco":
            columns, rows = board.name.columns, board.name.rows
            black = _squares(columns, rows, board.square_m)
            return _ruled(black + _charuco_markers(board), columns, rows, board.square_m)
        case "aprilgrid":
            return _aprilgrid(board)
        case _:
            return _circles(board)


def _ruled(black: list[list[float]], columns: int, rows: int, square_m: float) -> Shapes:
    """Squares whose first inner corner is the board's origin."""
    low = np.array([-square_m, -square_m])
    return Shapes(low, low + np.array([columns, rows]) * square_m, _boxes(black), np.zeros((0, 3)))


def _squares(columns: int, rows: int, square_m: float) -> list[list[float]]:
    """Every second square, beginning with the top left one."""
    return [
        [(column - 1) * square_m, (row - 1) * square_m, square_m, square_m]
        for row in range(rows)
        for column in range(columns)
        if (row + column) % 2 == 0
    ]


def _charuco_markers(board: Board) -> list[list[float]]:
    made = charuco_of(board)
    black: list[list[float]] = []
    for corners, marker in zip(made.getObjPoints(), made.getIds().ravel(), strict=True):
        # OpenCV's origin is the corner of the board, ours its first inner corner.
        x, y = np.asarray(corners, np.float64)[0, :2] - board.square_m
        black += _marker(board, int(marker), float(x), float(y), board.marker_m)
    return black


def _aprilgrid(board: Board) -> Shapes:
    points, gap = board.points_m[:, :2], board.marker_m
    black: list[list[float]] = []
    for tag, names in enumerate(april_ids(board)):
        x, y = points[names[0]].tolist()
        black += _marker(board, tag, x, y, board.square_m)
    # Small squares touch the tags' corners: where two black corners meet is known best.
    pitch = board.square_m + gap
    for row in range(board.name.rows + 1):
        for column in range(board.name.columns + 1):
            black.append([column * pitch - gap, row * pitch - gap, gap, gap])
    low, high = points.min(axis=0) - gap, points.max(axis=0) + gap
    return Shapes(low, high, _boxes(black), np.zeros((0, 3)))


def _circles(board: Board) -> Shapes:
    share = STAGGERED_RADIUS_SHARE if board.name.kind == "acircles" else RADIUS_SHARE
    points = board.points_m[:, :2]
    circles = np.column_stack([points, np.full(len(points), share * board.square_m)])
    margin = board.square_m
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return Shapes(low, high, np.zeros((0, 4)), circles)


def _marker(board: Board, marker: int, x: float, y: float, side_m: float) -> list[list[float]]:
    """The black cells of a marker, those of a row joined."""
    cells = _cells(board, marker)
    cell_m = side_m / len(cells)
    black = []
    for row, line in enumerate(cells == 0):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            black.append([x + begin * cell_m, y + row * cell_m, (end - begin) * cell_m, cell_m])
    return black


def _cells(board: Board, marker: int) -> UInt8:
    import cv2

    dictionary = dictionary_of(board)
    side = dictionary.markerSize + 2
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, marker, side), np.uint8)


def _boxes(black: list[list[float]]) -> Float64:
    return np.array(black, np.float64).reshape(-1, 4)


def raster(shapes: Shapes, pixels_per_m: float) -> UInt8:
    """The drawing as (H, W) grey pixels; edges between pixels are shaded by what they cover."""
    width, height = (int(np.ceil(side * pixels_per_m - 1e-6)) for side in shapes.size_m)
    boxes, circles = shapes.rectangles_m.copy(), shapes.circles_m.copy()
    boxes[:, :2] -= shapes.low_m
    circles[:, :2] -= shapes.low_m
    return shaded((height, width), boxes, circles, pixels_per_m)
