"""Which views of a film or of live cameras are worth keeping: steady, sharp, and new."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.structures.arrays import Float64, UInt8

# Corners of a steady board move less than this from one picture to the next, px for each 1000 px
# of the picture's width: eyes that are exposed half a picture apart then differ by half of it.
STEADY_PER_1000 = 1.0
# Edges of a sharp board rise within this, px for each 1000 px of the picture's width, at least 4.
# On three real sets they take 1.7 to 3.3 px, and where the board moved by 5 px during the exposure
# 3.2 to 6.1, typically 5.
SHARP_PER_1000, LEAST_SHARP_PX = 4.0, 4.0
# A new view differs from all others by this, in shares of the picture (`ViewPlace`).
NEW_DISTANCE = 0.1
# What changes perspective tells more of a lens than a shift does: a lean counts so many times.
LEAN_WEIGHT = 4
# Percentiles of gradients and of grey levels that are taken for the steepest, dark and bright.
STEEPEST, DARK, BRIGHT = 99, 5, 95


@dataclass(frozen=True)
class ViewPlace:
    """Where and how a board stands in a picture, in shares of the picture.

    Args:
        x: middle of the board, 0 left to 1 right.
        y: the same, 0 top to 1 bottom.
        size: root of the share of the picture that the corners cover.
        lean_x: by how much the right side is seen larger than the left one, -1 to 1.
        lean_y: by how much the bottom is seen larger than the top.
        roll: direction of the board's rows, half-turns.
    """

    x: float
    y: float
    size: float
    lean_x: float
    lean_y: float
    roll: float

    @classmethod
    def of(cls, corners: Corners, points_m: Float64, size_px: tuple[int, int]) -> Self:
        """Of the corners of a board with corners `points_m` (N, 3) in a picture.

        A homography of the board tells it, so that parts of boards will do.

        Args:
            corners: as they are seen.
            points_m: (N, 3) all corners of the board by id, in its own frame.
            size_px: (width, height) of the picture.
        """
        import cv2

        xy = points_m[corners.ids][:, :2]
        H, _ = cv2.findHomography(xy, corners.uv)
        if H is None:
            H = np.diag([1.0, 1.0, 1.0])
        low, high = points_m[:, :2].min(axis=0), points_m[:, :2].max(axis=0)
        outline = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        uv = cv2.perspectiveTransform(outline[None], H)[0]
        width, height = size_px
        middle = corners.uv.mean(axis=0)
        area = 0.5 * abs(float(np.dot(uv[:, 0], np.roll(uv[:, 1], 1))
                               - np.dot(uv[:, 1], np.roll(uv[:, 0], 1))))  # fmt: skip
        top, right, bottom, left = np.linalg.norm(np.roll(uv, -1, axis=0) - uv, axis=1)
        along = uv[1] - uv[0] + uv[2] - uv[3]
        return cls(
            float(middle[0] / width),
            float(middle[1] / height),
            float(np.sqrt(min(area / (width * height), 1.0))),
            float((right - left) / max(right + left, 1e-9)),
            float((bottom - top) / max(bottom + top, 1e-9)),
            float(np.arctan2(along[1], along[0]) / np.pi),
        )

    def distance(self, other: ViewPlace) -> float:
        """How different two views are; what changes perspective counts more than a shift."""
        turned = abs((self.roll - other.roll + 0.5) % 1.0 - 0.5)
        parts = (
            self.x - other.x,
            self.y - other.y,
            self.size - other.size,
            LEAN_WEIGHT * (self.lean_x - other.lean_x),
            LEAN_WEIGHT * (self.lean_y - other.lean_y),
            turned,
        )
        return float(np.linalg.norm(parts))


def is_new(place: ViewPlace, others: Sequence[ViewPlace]) -> bool:
    """Whether a view shows something that none of the others does."""
    return all(place.distance(other) >= NEW_DISTANCE for other in others)


def movement_px(before: Corners, now: Corners) -> float:
    """Median distance that corners moved, px; infinite where none is in both."""
    ids, here, there = np.intersect1d(before.ids, now.ids, return_indices=True)
    if not len(ids):
        return float("inf")
    return float(np.median(np.linalg.norm(before.uv[here] - now.uv[there], axis=1)))


def moved_per_1000(before: Corners, now: Corners, width_px: int) -> float:
    """How far a board moved from one picture to the next, px for each 1000 px of their width.

    Args:
        before: corners in the picture before.
        now: in this one.
        width_px: of both.
    """
    return movement_px(before, now) * 1000 / width_px


def edge_width_px(grey: UInt8, corners: Corners, points_m: Float64) -> float:
    """How many pixels the edges of a board take from dark to bright; 2 to 3 where it is sharp.

    Of the edges along rows and along columns the blurrier ones count: what moves is blurred along
    its way alone.

    Args:
        grey: (H, W) the picture.
        corners: of the board in it.
        points_m: (N, 3) all corners of the board by id, in its own frame.
    """
    low = np.floor(corners.uv.min(axis=0)).astype(int).clip(0)
    high = np.ceil(corners.uv.max(axis=0)).astype(int) + 1
    part = grey[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    if min(part.shape, default=0) < 3:
        return float("inf")
    down, across = np.gradient(part)
    steepest = min(
        float(np.percentile(np.abs(x * across + y * down), STEEPEST))
        for x, y in _edge_normals(corners, points_m)
    )
    contrast = float(np.percentile(part, BRIGHT) - np.percentile(part, DARK))
    return contrast / steepest if steepest > 0 else float("inf")


def _edge_normals(corners: Corners, points_m: Float64) -> Float64:
    """(2, 2) directions in the picture across a board's columns, and across its rows."""
    xy = points_m[corners.ids][:, :2]
    along = np.linalg.lstsq(xy - xy.mean(axis=0), corners.uv - corners.uv.mean(axis=0))[0]
    (row_x, row_y), (column_x, column_y) = along.tolist()
    normals = np.array([[-column_y, column_x], [-row_y, row_x]])
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


def is_sharp(grey: UInt8, corners: Corners, points_m: Float64) -> bool:
    """Whether the edges of a board are sharp enough to be found to a fraction of a pixel."""
    limit_px = max(LEAST_SHARP_PX, SHARP_PER_1000 * grey.shape[1] / 1000)
    return bool(edge_width_px(grey, corners, points_m) <= limit_px)
