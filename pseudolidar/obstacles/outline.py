"""A plain thing of one colour, told by its outline: where both eyes see its edges."""

from __future__ import annotations

import numpy as np

from pseudolidar.obstacles.hues import unit_rgb
from pseudolidar.obstacles.patch_matching import (
    LEVELS,
    PatchDepth,
    depth_of_match,
    there_and_back,
    window_means,
)
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.spots import Spot
from pseudolidar.obstacles.subpixel_edges import edges_px
from pseudolidar.structures.arrays import Float32
from pseudolidar.structures.box import Detection

# So much beside the thing is looked at along with it, px.
RIM_PX = 2
# Fewer rows tell no edge; larger things have surfaces of their own in the depth map.
LEAST_ROWS, MOST_SIDE_PX = 3, 128
# A colour that differs from the thing's by this, of 1, is another one.
OTHER_COLOUR = 0.35
# How well an edge is known, and by how much its way from eye to eye may differ from that of the
# other edge, px.
EDGE_PX, DIFFER_PX = 0.08, 1.0
# Narrower things, px, are found in wrong places; shifted by this share of its width, a plain thing
# is still like itself.
LEAST_WIDTH_PX, ALIKE_SHARE = 5.0, 0.4


def outline_depth(sight: Sight, detection: Detection) -> PatchDepth | None:
    """Depth of a flat thing that stands out of what is behind it by its colour.

    It is found in the right picture by which pixels are of its mean colour; its left and its right
    edge in both, by how their pixels mix with what is beside them, tell the disparity.

    Returns:
        None where there are no two colour pictures, it is cut, large, or not found once.
    """
    window = _window(sight, detection)
    if sight.rig is None or window is None or sight.right is None or sight.right.ndim != 3:
        return None
    rows, columns = window
    assert detection.mask is not None  # _window
    left, right = unit_rgb(sight.image), unit_rgb(sight.right)
    inside = detection.mask[rows, columns]
    if not inside.any():
        return None
    colour = left[rows, columns][inside].mean(axis=0)
    shown, seen = (_likeness(one, rows, colour) for one in (left, right))
    width = columns.stop - columns.start
    means = [window_means(one[rows][:, :, None], width) for one in (shown, seen)]
    beside_px = round(ALIKE_SHARE * width)
    place = there_and_back(shown, seen, window, (means[0], means[1]), beside_px=beside_px)
    if place is None:
        return None
    at, correlation = place
    here = _sides(left, shown, rows, columns)
    there = _sides(right, seen, rows, slice(at, at + width))
    if here is None or there is None:
        return None
    ways = here[0] - there[0], here[1] - there[1]
    differ_px = abs(ways[0] - ways[1])
    if differ_px > DIFFER_PX:
        return None
    disparity_px = 0.5 * (ways[0] + ways[1])
    sigma_px = float(np.hypot(EDGE_PX, 0.5 * differ_px))
    return depth_of_match(sight.rig, disparity_px, sigma_px, window, correlation)


def _window(sight: Sight, detection: Detection) -> tuple[slice, slice] | None:
    """Its inner rows, and its columns with a rim; None of what is cut, large or small."""
    if detection.mask is None:
        return None
    left, top, right, bottom = detection.box_px
    rows = slice(int(np.ceil(top)) + 1, int(np.floor(bottom)))
    columns = slice(int(np.floor(left)) - RIM_PX, int(np.ceil(right)) + RIM_PX + 1)
    width, height = sight.camera.size_px
    inside = columns.start >= 0 and columns.stop <= width and rows.start >= 0
    inside &= rows.stop <= height and rows.stop - rows.start >= LEAST_ROWS
    small = max(rows.stop - rows.start, columns.stop - columns.start) <= MOST_SIDE_PX
    wide = right - left + 1 >= LEAST_WIDTH_PX
    return (rows, columns) if inside and small and wide else None


def _likeness(rgb: Float32, rows: slice, colour: Float32) -> Float32:
    """(H, W) levels: how near the colour of each pixel of these rows is; 0 in all others."""
    levels = np.zeros(rgb.shape[:2], np.float32)
    off = np.linalg.norm(rgb[rows] - colour, axis=2)
    levels[rows] = LEVELS * np.clip(1.0 - off / OTHER_COLOUR, 0.0, 1.0)
    return levels


def _sides(
    rgb: Float32, likeness: Float32, rows: slice, columns: slice
) -> tuple[float, float] | None:
    """Its left and right edge in one eye, px; None where nothing is of its colour."""
    mask = np.zeros(likeness.shape, np.bool_)
    mask[rows, columns] = likeness[rows, columns] > 0.5 * LEVELS
    if not mask.any():
        return None
    left, _, right, _ = edges_px(mask, Spot(rows, columns, mask[rows, columns]), rgb)
    return left, right
