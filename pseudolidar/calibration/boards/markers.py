"""Boards with markers, ChArUco and AprilGrid, in pictures: whole or in parts."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from pseudolidar.calibration.boards.board import DICTIONARIES, Board
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.refine import astray, refined_saddles
from pseudolidar.structures.arrays import Float64, Int64, UInt8

# Corners without which a view of a marker board is not used.
LEAST_CORNERS = 6
# Widths of the black border of tags, in bits: OpenCV's, and Kalibr's.
BORDERS = (1, 2)
# A tag's corner may be off the place that all others give it by this share of the tag's side.
ASTRAY_SHARE = 0.15
# The same while the way in which tags begin is looked for: a wrong way is off by half a tag.
WRONG_WAY_SHARE = 0.1
# Half-width of the window in which a tag's corner is sought: this share of the gap, within limits.
REACH_SHARE, LEAST_REACH_PX, MOST_REACH_PX = 0.3, 2, 6
# OpenCV's steps to a corner, and the move that ends them, px.
STEPS, ARRIVED_PX = 40, 1e-3
# Side of a square where no two corners beside each other are seen, px.
USUAL_SQUARE_PX = 10.0


def find_charuco(grey: UInt8, board: Board) -> Corners | None:
    """The inner corners of a ChArUco board, as far as they are seen."""
    best: Corners | None = None
    for legacy in (False, True):
        uv, ids = _detector(board, legacy).detectBoard(grey)[:2]
        if ids is None or len(ids) < LEAST_CORNERS:
            continue
        found = _refined(grey, Corners(ids.ravel().astype(np.int64), _flat(uv)), board)
        if best is None or len(found) > len(best):
            best = found
        if len(found) > 0.5 * len(board.points_m):
            break  # the other pattern would have at most what is left
    return best if best is not None and len(best) >= LEAST_CORNERS else None


def find_aprilgrid(grey: UInt8, board: Board) -> Corners | None:
    """The corners of the tags of an AprilGrid, as far as they are seen."""
    for bits in BORDERS:
        tags = _tags(grey, board, bits)
        if 4 * len(tags) < LEAST_CORNERS:
            continue
        uv = np.stack(list(tags.values()))
        corners = _on_board(uv, np.array(list(tags), np.int64), board)
        if len(corners) >= LEAST_CORNERS:
            return _refined_tags(grey, corners, _side_px(uv) * board.marker_m / board.square_m)
    return None


def _tags(grey: UInt8, board: Board, bits: int) -> dict[int, Float64]:
    """(4, 2) corners of the board's tags that are seen, by number.

    By outlines most are found; by lines those too that are small, and touch their neighbours.
    """
    found: dict[int, Float64] = {}
    for lines in (False, True):
        quads, ids, _ = _tag_detector(board, bits, lines).detectMarkers(grey)
        for tag, quad in zip(() if ids is None else ids.ravel().tolist(), quads, strict=True):
            if tag < board.name.columns * board.name.rows:
                found.setdefault(tag, _flat(quad))
        if len(found) == board.name.columns * board.name.rows:
            break
    return found


def _refined_tags(grey: UInt8, found: Corners, gap_px: float) -> Corners:
    """At the saddles where small squares between the tags touch them, else at the corners."""
    import cv2

    reach = int(np.clip(REACH_SHARE * gap_px, LEAST_REACH_PX, MOST_REACH_PX))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, STEPS, ARRIVED_PX)
    at = np.ascontiguousarray(found.uv, np.float32).reshape(-1, 1, 2)
    fine = _flat(cv2.cornerSubPix(grey, at, (reach, reach), (-1, -1), stop))
    uv, saddle = refined_saddles(grey, fine, np.full(len(fine), gap_px))
    return Corners(found.ids, np.where(saddle[:, None], uv, fine))


def april_ids(board: Board) -> Int64:
    """(T, 4) which corners of the board a tag's are, clockwise from its top left.

    Tags are numbered as Kalibr does: from the bottom left, along rows, upwards.
    """
    columns, rows = board.name.columns, board.name.rows
    tag = np.arange(columns * rows)
    left, top = 2 * (tag % columns), 2 * (rows - 1 - tag // columns)
    wide = 2 * columns
    first = top * wide + left
    return np.stack([first, first + 1, first + wide + 1, first + wide], axis=1).astype(np.int64)


def _on_board(uv: Float64, tags: Int64, board: Board) -> Corners:
    """Corners by id. Tags of other makers begin at another corner: what all agree on counts."""
    import cv2

    names = april_ids(board)[tags]
    points, side_px = board.points_m[:, :2], _side_px(uv)
    best, most = Corners(np.zeros(0, np.int64), np.zeros((0, 2))), (0, 0.0)
    for turn in range(4):
        flat, at = np.roll(names, -turn, axis=1).ravel(), uv.reshape(-1, 2)
        H = cv2.findHomography(points[flat], at, cv2.RANSAC, WRONG_WAY_SHARE * side_px)[0]
        if H is None:
            continue
        off = np.linalg.norm(cv2.perspectiveTransform(points[flat][None], H)[0] - at, axis=1)
        near = off < max(ASTRAY_SHARE * side_px, 4 * float(np.median(off)))
        # A wrong way may fit half of the corners of a few tags as well as the right one fits all.
        fits = int((off < ASTRAY_SHARE * side_px).sum()), -float(np.median(off))
        if fits > most:
            most, best = fits, Corners(flat[near], at[near])
    return best


def _side_px(uv: Float64) -> float:
    return float(np.median(np.linalg.norm(np.roll(uv, -1, axis=1) - uv, axis=-1)))


def _refined(grey: UInt8, found: Corners, board: Board) -> Corners:
    """At the saddles; corners without one are left out."""
    square_px = np.full(len(found), _square_px(found, board))
    uv, good = refined_saddles(grey, found.uv, square_px)
    good &= ~astray(uv, found.ids, square_px, board.grid[0])
    return Corners(found.ids[good], uv[good])


def _square_px(found: Corners, board: Board) -> float:
    """Distance of neighbouring corners, px: the least that two of them have."""
    columns = board.grid[0]
    at = dict(zip(found.ids.tolist(), found.uv, strict=True))
    steps = [
        float(np.linalg.norm(at[corner] - at[corner + step]))
        for corner in at
        for step in (1, columns)
        if corner + step in at and (step != 1 or (corner + 1) % columns)
    ]
    return float(np.median(steps)) if steps else USUAL_SQUARE_PX


def dictionary_of(board: Board) -> Any:
    """OpenCV's dictionary of the board's markers."""
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARIES[board.dictionary]))


def charuco_of(board: Board, *, legacy: bool = False) -> Any:
    """OpenCV's ChArUco board."""
    import cv2

    size = board.name.columns, board.name.rows
    made = cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, dictionary_of(board))
    made.setLegacyPattern(legacy)
    return made


@lru_cache
def _detector(board: Board, legacy: bool) -> Any:
    import cv2

    return cv2.aruco.CharucoDetector(charuco_of(board, legacy=legacy))


@lru_cache
def _tag_detector(board: Board, bits: int, lines: bool) -> Any:
    import cv2

    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = bits
    if lines:
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    return cv2.aruco.ArucoDetector(dictionary_of(board), settings)


def _flat(uv: Any) -> Float64:
    return np.asarray(uv, np.float64).reshape(-1, 2)
