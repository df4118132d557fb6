"""Pictures of any size for a network of one size, of free size, or too large for the memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pseudolidar.errors import StereoConfig
from pseudolidar.geometry.spans import spans
from pseudolidar.stereo.networks.reading import resized_map
from pseudolidar.structures.arrays import Float32, UInt8
from pseudolidar.structures.image_size import ImageSize

Run = Callable[[UInt8, UInt8], Float32]

# Pixels at a tile's inner edges that do not count, and over which one tile fades into the next.
MARGIN_PX, FADE_PX = 16, 32
# Tiles that differ by more than this, or this share of the disparity, at one pixel do not know it.
SEAM_PX, SEAM_SHARE = 1.0, 0.05


def padded(run: Run, left: UInt8, right: UInt8, multiple: int) -> Float32:
    """Run on images whose edges are multiples of a number.

    Rows are repeated at the top and columns at the right, as for KITTI's benchmark: what is
    repeated at the right is a match of nothing in the picture, and columns keep their numbers.
    """
    height, width = left.shape[:2]
    top, side = -height % multiple, -width % multiple
    if not top and not side:
        return run(left, right)
    border = ((top, 0), (0, side), (0, 0))
    wide = [np.pad(image, border, mode="edge") for image in (left, right)]
    return np.ascontiguousarray(run(wide[0], wide[1])[top:, :width])


def resized(run: Run, left: UInt8, right: UInt8, size: ImageSize) -> Float32:
    """Run on images of another size; the disparities grow with the width."""
    import cv2

    height, width = left.shape[:2]
    if (width, height) == (size.width, size.height):
        return run(left, right)
    smaller = size.width < width
    how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    wanted = (size.width, size.height)
    images = [cv2.resize(image, wanted, interpolation=how) for image in (left, right)]
    found = run(np.asarray(images[0], np.uint8), np.asarray(images[1], np.uint8))
    return resized_map(found * np.float32(width / size.width), (width, height))


def tiled(run: Run, left: UInt8, right: UInt8, tile: ImageSize, range_px: int) -> Float32:
    """Run on tiles and fade them into each other.

    A tile knows nothing of its first columns, whose matches lie left of it: tiles overlap by the
    range and are used from there on. Where tiles that overlap disagree there is no disparity.

    Args:
        run: disparities of a pair of tiles.
        left: (H, W, 3).
        right: like left.
        tile: size.
        range_px: largest disparity that is looked for.

    Raises:
        StereoConfig: the tile is too narrow for the range.
    """
    height, width = left.shape[:2]
    blind = range_px + MARGIN_PX
    overlap = blind + FADE_PX + MARGIN_PX
    if tile.width < width and tile.width < 2 * overlap:
        raise StereoConfig(
            f"tiles {tile.width} px wide for disparities up to {range_px} px",
            want=f"at least {2 * overlap} px",
            fix="Enlarge --matcher.tile, or raise --min-depth.",
            where="tile",
        )
    total, weight = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    low, high = np.full_like(total, np.inf), np.full_like(total, -np.inf)
    rows = list(spans(height, tile.height, 2 * MARGIN_PX + FADE_PX))
    for top, bottom in rows:
        for start, end in spans(width, tile.width, overlap):
            place = np.s_[top:bottom, start:end]
            found = run(np.ascontiguousarray(left[place]), np.ascontiguousarray(right[place]))
            across = _fade(end - start, blind if start else 0, MARGIN_PX if end < width else 0)
            down = _fade(bottom - top, MARGIN_PX if top else 0, MARGIN_PX if bottom < height else 0)
            known = down[:, None] * across[None] * np.isfinite(found)
            total[place] += known * np.where(np.isfinite(found), found, 0)
            weight[place] += known
            seen = np.where(known > 0, found, np.nan)
            low[place] = np.fmin(low[place], seen)
            high[place] = np.fmax(high[place], seen)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / weight
        torn = high - low > np.maximum(SEAM_PX, SEAM_SHARE * mean)
    return np.asarray(np.where((weight > 0) & ~torn, mean, np.nan), np.float32)


def _fade(length: int, blind: int, margin_after: int) -> Float32:
    """Weights along a tile: 0 in the blind part, then up; down again towards a neighbour."""
    at = np.arange(length, dtype=np.float32)
    up = np.ones_like(at) if not blind else np.clip((at - blind + 1) / FADE_PX, 0, 1)
    down = np.ones_like(at)
    if margin_after:
        down = np.clip((length - margin_after - at) / FADE_PX, 0, 1)
    return np.asarray(np.minimum(up, down), np.float32)
