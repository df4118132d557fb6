"""The parts of a picture that a detector looks at: the whole, and overlapping tiles of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.spans import spans
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.image_size import ImageSize

# Neighbours share this part of a tile: what is smaller lies whole in one of them.
OVERLAP_SHARE = 0.25
# A box that ends this near to a cut through the picture ends because of it.
CUT_PX = 3.0


@dataclass(frozen=True)
class Crop:
    """A part of a picture.

    Args:
        left: first column.
        top: first row.
        width: px.
        height: px.
    """

    left: int
    top: int
    width: int
    height: int

    def cuts(self, boxes: Float64, picture: tuple[int, int]) -> Bool:
        """(N,) boxes that end where the picture goes on beyond this part.

        Args:
            boxes: (N, 4) in picture coordinates.
            picture: (height, width) px.
        """
        height, width = picture
        right, bottom = self.left + self.width, self.top + self.height
        cut = np.zeros(len(boxes), np.bool_)
        if self.left > 0:
            cut |= boxes[:, 0] < self.left + CUT_PX
        if self.top > 0:
            cut |= boxes[:, 1] < self.top + CUT_PX
        if right < width:
            cut |= boxes[:, 2] > right - 1 - CUT_PX
        if bottom < height:
            cut |= boxes[:, 3] > bottom - 1 - CUT_PX
        return cut


def crops(picture: tuple[int, int], tile: ImageSize | None) -> list[Crop]:
    """The whole picture, then its tiles, row by row.

    Args:
        picture: (height, width) px.
        tile: size of the tiles; None for the whole alone.
    """
    height, width = picture
    whole = Crop(0, 0, width, height)
    if tile is None or (tile.width >= width and tile.height >= height):
        return [whole]
    rows = spans(height, tile.height, int(tile.height * OVERLAP_SHARE))
    columns = list(spans(width, tile.width, int(tile.width * OVERLAP_SHARE)))
    tiles = [
        Crop(left, top, right - left, bottom - top)
        for top, bottom in rows
        for left, right in columns
    ]
    return [whole, *tiles]
