"""Corners of chessboards to a fraction of a pixel, and those that went astray back to the grid."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Bool, Float64, Int64, UInt8

# Half-width of the window that a saddle is fitted in: this share of the distance of corners, within
# limits, px. On three real sets (2 to 9 px of 9 to 22 px tried) 0.15 fits best, and hardly matters.
WINDOW_SHARE, LEAST_WINDOW_PX, MOST_WINDOW_PX = 0.15, 2.0, 8.0
STEPS, ARRIVED_PX = 8, 1e-3
# A saddle that is bent this much less than the others is one of noise.
LEAST_BEND = 0.15
# A corner further from where its neighbours say it is was found at something else: share of the
# distance of corners.
ASTRAY_SHARE = 0.12
# Share of the distance of corners by which a saddle's fit may move a corner.
LARGEST_MOVE_SHARE = 0.35
# It may move them by this in any case, px: corners are given to a few pixels.
LEAST_MOVE_PX = 1.5
# Corners that went astray are looked for so often where they belong.
SOUGHT_AGAIN = 2
# Rows and columns, and corners in all, from which on a grid is a cubic or a quadratic image.
CUBIC_FROM, QUADRATIC_FROM = (5, 20), (3, 9)
# How often its weights are found anew; corners are never surer than this, px.
GRID_ROUNDS, LEAST_OFF_PX = 10, 1e-3


def refined_saddles(grey: UInt8, uv: Float64, spacing_px: Float64) -> tuple[Float64, Bool]:
    """Where the grey values near each corner have their saddle.

    Args:
        grey: the picture.
        uv: (N, 2) corners, to a few pixels.
        spacing_px: (N,) distance of each to the next corner.

    Returns:
        (N, 2) corners, and (N,) whether there is a saddle near; where none is, they are as before.

    Source: Lucchese and Mitra, Using saddle points for subpixel feature detection in camera
    calibration targets, 2002; smoothed with a cone as by Placht et al., ROCHADE, 2014.
    """
    import cv2

    half_px = float(np.clip(WINDOW_SHARE * np.median(spacing_px), LEAST_WINDOW_PX, MOST_WINDOW_PX))
    smooth = cv2.filter2D(grey.astype(np.float32), -1, _cone(half_px))
    reach = int(np.ceil(half_px))
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    round_ = np.hypot(dx, dy) <= half_px + 0.5
    x, y = dx[round_], dy[round_]
    fit = np.linalg.pinv(np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=1))
    at, good = uv.copy(), np.ones(len(uv), np.bool_)
    for _ in range(STEPS):
        map_x = (at[:, :1] + x).astype(np.float32)
        map_y = (at[:, 1:] + y).astype(np.float32)
        patch = cv2.remap(smooth, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        xx, xy, yy, gx, gy = (patch.astype(np.float64) @ fit.T)[:, :5].T
        bend = 4 * xx * yy - xy * xy
        good &= bend < 0
        safe = np.where(bend < 0, bend, -1.0)
        step = np.stack([xy * gy - 2 * yy * gx, xy * gx - 2 * xx * gy], axis=1) / safe[:, None]
        length = np.linalg.norm(step, axis=1)
        step *= np.minimum(1.0, 1.0 / np.maximum(length, 1e-12))[:, None]
        at = np.where(good[:, None], at + step, at)
        if not (good & (length > ARRIVED_PX)).any():
            break
    strength = np.sqrt(np.maximum(-bend, 0.0))
    good &= strength >= LEAST_BEND * np.median(strength)
    good &= np.linalg.norm(at - uv, axis=1) <= np.maximum(
        LARGEST_MOVE_SHARE * spacing_px, LEAST_MOVE_PX
    )
    inside = (at >= 0).all(axis=1) & (at <= np.array(grey.shape[::-1]) - 1).all(axis=1)
    good &= inside
    return np.where(good[:, None], at, uv), good


def spacing(uv: Float64, columns: int, rows: int) -> Float64:
    """(N,) distance of each corner of a whole grid to the nearest beside it, px.

    Args:
        uv: (N, 2) px, row by row.
        columns: of the grid.
        rows: of the grid.
    """
    grid = uv.reshape(rows, columns, 2)
    nearest = np.full((rows, columns), np.inf)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=-1)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=-1)
    for part, length in (
        (np.s_[:, :-1], across),
        (np.s_[:, 1:], across),
        (np.s_[:-1], down),
        (np.s_[1:], down),
    ):
        nearest[part] = np.minimum(nearest[part], length)
    return nearest.ravel()


def on_grid(grey: UInt8, uv: Float64, columns: int, rows: int) -> tuple[Float64, Bool]:
    """Refined corners of a whole grid; those that went astray are looked for where they belong.

    Args:
        grey: the picture.
        uv: (N, 2) corners, row by row, to a few pixels.
        columns: of the grid.
        rows: of the grid.

    Returns:
        (N, 2) corners, and (N,) which of them are sure.
    """
    near_px, ids = spacing(uv, columns, rows), np.arange(len(uv), dtype=np.int64)
    found, good = refined_saddles(grey, uv, near_px)
    for _ in range(SOUGHT_AGAIN):
        lost = astray(found, ids, near_px, columns)
        if not lost.any():
            break
        wanted = _smooth_grid(found, ids, columns)
        found[lost], good[lost] = refined_saddles(grey, wanted[lost], near_px[lost])
    return found, good & ~astray(found, ids, near_px, columns)


def astray(uv: Float64, ids: Int64, spacing_px: Float64, columns: int) -> Bool:
    """(N,) corners that are not where the others say that they are.

    Args:
        uv: (N, 2) corners.
        ids: (N,) which of a grid's.
        spacing_px: (N,) distance of each to the next corner.
        columns: of the grid.
    """
    off = np.linalg.norm(uv - _smooth_grid(uv, ids, columns), axis=1)
    return np.asarray(off > ASTRAY_SHARE * spacing_px)


def _smooth_grid(uv: Float64, ids: Int64, columns: int) -> Float64:
    """Where a smooth image of the grid has its corners: a robust polynomial of column and row."""
    row, column = (_scaled(index) for index in np.divmod(ids, columns))
    fewest = min(len(np.unique(row)), len(np.unique(column)))
    enough = [fewest >= lines and len(uv) >= n for lines, n in (QUADRATIC_FROM, CUBIC_FROM)]
    order = 1 + sum(enough)
    terms = np.stack(
        [column**i * row**j for i in range(order + 1) for j in range(order + 1 - i)], axis=1
    )
    weights = np.ones(len(uv))
    fitted = uv
    for _ in range(GRID_ROUNDS):
        root = np.sqrt(weights)[:, None]
        fitted = terms @ np.linalg.lstsq(terms * root, uv * root, rcond=None)[0]
        off = np.linalg.norm(uv - fitted, axis=1)
        weights = 1 / (1 + (off / max(2 * float(np.median(off)), LEAST_OFF_PX)) ** 2)
    return np.asarray(fitted)


def _scaled(index: Int64) -> Float64:
    """From -1 to 1."""
    low, high = int(index.min()), int(index.max())
    return np.asarray(2.0 * (index - low) / max(high - low, 1) - 1.0)


def _cone(half_px: float) -> AnyArray:
    reach = int(np.ceil(half_px))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    cone = np.maximum(0.0, half_px + 1 - np.hypot(x, y))
    return np.asarray(cone / cone.sum())
