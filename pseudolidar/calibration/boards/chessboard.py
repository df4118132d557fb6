"""Chessboards in pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.refine import on_grid
from pseudolidar.structures.arrays import AnyArray, Float64, UInt8

# Boards are looked for in pictures of at most this width, px; corners are refined in the whole one.
SEARCH_WIDTH_PX = 1600
# Smaller pictures are looked at enlarged, too.
SMALL_WIDTH_PX = 900
# A board with a smaller share of sure corners is taken for something else.
LEAST_SURE = 0.5


def find_chessboard(grey: UInt8, board: Board, *, thorough: bool) -> Corners | None:
    """The inner corners of a chessboard that is seen whole.

    Args:
        grey: the picture.
        board: which one.
        thorough: try slower ways where the first fails.
    """
    columns, rows = board.grid
    for uv in _candidates(grey, columns, rows, thorough=thorough):
        found, sure = on_grid(grey, uv, columns, rows)
        if sure.mean() >= LEAST_SURE:
            return Corners(np.flatnonzero(sure), found[sure])
    return None


def _candidates(grey: UInt8, columns: int, rows: int, *, thorough: bool) -> Iterator[Float64]:
    """Corners as one way after another finds them."""
    import cv2

    usual = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    ratio = min(1.0, SEARCH_WIDTH_PX / grey.shape[1])
    searched = grey if ratio == 1 else _resized(grey, ratio)
    found, uv = cv2.findChessboardCorners(searched, (columns, rows), flags=usual)
    if found:
        yield _at_full_size(uv, ratio)
    if not thorough:
        return
    flat = cv2.createCLAHE(3.0, (8, 8)).apply(searched)
    found, uv = cv2.findChessboardCorners(flat, (columns, rows), flags=usual)
    if found:
        yield _at_full_size(uv, ratio)
    sb = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    for scale in (1.0, 2.0) if searched.shape[1] <= SMALL_WIDTH_PX else (1.0,):
        picture = searched if scale == 1 else _resized(searched, scale)
        found, uv = cv2.findChessboardCornersSB(picture, (columns, rows), flags=sb)
        if found:
            yield _at_full_size(uv, ratio * scale)


def _resized(grey: UInt8, ratio: float) -> UInt8:
    import cv2

    way = cv2.INTER_AREA if ratio < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(grey, None, fx=ratio, fy=ratio, interpolation=way), np.uint8)


def _at_full_size(uv: AnyArray, ratio: float) -> Float64:
    """(N, 2) pixels of the whole picture, from those of one resized by `ratio`."""
    flat = np.asarray(uv, np.float64).reshape(-1, 2)
    return (flat + 0.5) / ratio - 0.5
