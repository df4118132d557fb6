"""Grids of circles in pictures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.structures.arrays import UInt8

# Blobs that are looked for, as shares of the picture's area.
SMALLEST_BLOB, LARGEST_BLOB = 2e-5, 2e-2
# Smallest blob all the same, px^2, and how near two may be, px.
LEAST_BLOB_PX2, LEAST_APART_PX = 12.0, 3.0
# How full the outline of a blob must be, and how round: an ellipse's axes, short by long.
LEAST_CONVEXITY, LEAST_INERTIA = 0.9, 0.1


def find_circles(grey: UInt8, board: Board, *, thorough: bool) -> Corners | None:
    """The centres of a grid of dark circles on light ground, or the other way round, seen whole.

    A circle that is seen from the side is an ellipse whose middle is not the image of the circle's
    middle; small circles keep that below what matters.

    Args:
        grey: the picture.
        board: which one.
        thorough: try slower ways where the first fails.
    """
    import cv2

    columns, rows = board.grid
    shape = (
        cv2.CALIB_CB_ASYMMETRIC_GRID
        if board.name.kind == "acircles"
        else cv2.CALIB_CB_SYMMETRIC_GRID
    )
    for picture, flags in _ways(grey, shape, thorough=thorough):
        found, centres = cv2.findCirclesGrid(
            picture, (columns, rows), flags=flags, blobDetector=_blobs(picture)
        )
        if found and centres is not None:
            uv = np.asarray(centres, np.float64).reshape(-1, 2)
            return Corners(np.arange(len(uv), dtype=np.int64), uv)
    return None


def _ways(grey: UInt8, shape: int, *, thorough: bool) -> Iterator[tuple[UInt8, int]]:
    import cv2

    yield grey, shape
    if not thorough:
        return
    yield grey, shape | cv2.CALIB_CB_CLUSTERING
    light_on_dark = np.asarray(255 - grey, np.uint8)
    yield light_on_dark, shape
    yield light_on_dark, shape | cv2.CALIB_CB_CLUSTERING


def _blobs(grey: UInt8) -> Any:
    import cv2

    library: Any = cv2  # whose type stubs lack the blob detector
    settings = library.SimpleBlobDetector_Params()
    area = float(grey.size)
    settings.minArea = max(LEAST_BLOB_PX2, SMALLEST_BLOB * area)
    settings.maxArea = LARGEST_BLOB * area
    settings.minDistBetweenBlobs = LEAST_APART_PX
    settings.filterByConvexity, settings.minConvexity = True, LEAST_CONVEXITY
    settings.filterByInertia, settings.minInertiaRatio = True, LEAST_INERTIA
    return library.SimpleBlobDetector_create(settings)
