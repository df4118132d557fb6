"""A picture of any size in a network's input, and exactly the way back.

Network coordinates are pixels of the input counted from its edge, (0, 0) the outer corner of the
first pixel; picture coordinates have (0, 0) at its centre. Resizing maps edges on edges, so that
the way back knows the scale as it came out, rounded to whole pixels, of each axis by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.networks.layout import Fit
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.image_size import ImageSize


@dataclass(frozen=True)
class Placement:
    """Where a picture, or a part of one, lies in a network's input.

    Args:
        scale: pixels of the input in one of the picture, along x and y.
        offset: of the picture's first column and row in the input, px.
        origin: of the part in its whole picture, columns and rows.
        part: width and height of the part, px.
    """

    scale: tuple[float, float]
    offset: tuple[int, int]
    origin: tuple[int, int]
    part: tuple[int, int]

    def to_picture(self, boxes: Float64) -> Float64:
        """(N, 4) left, top, right, bottom: from network to picture coordinates, of the whole."""
        inside = (boxes - np.array(self.offset * 2)) / np.array(self.scale * 2)
        return np.asarray(inside + np.array(self.origin * 2) - 0.5, np.float64)

    def to_network(self, boxes: Float64) -> Float64:
        """(N, 4) left, top, right, bottom: from picture, of the whole, to network coordinates."""
        inside = (boxes - np.array(self.origin * 2) + 0.5) * np.array(self.scale * 2)
        return np.asarray(inside + np.array(self.offset * 2), np.float64)


def placement(
    part: tuple[int, int], size: ImageSize, fit: Fit | None, origin: tuple[int, int] = (0, 0)
) -> Placement:
    """How a part of (width, height) px is laid into an input of a size."""
    width, height = part
    if fit in ("stretch", "as-is"):
        return Placement((size.width / width, size.height / height), (0, 0), origin, part)
    ratio = min(size.width / width, size.height / height)
    laid = (max(1, round(width * ratio)), max(1, round(height * ratio)))
    offset = (0, 0)
    if fit == "centre":
        offset = ((size.width - laid[0]) // 2, (size.height - laid[1]) // 2)
    return Placement((laid[0] / width, laid[1] / height), offset, origin, part)


def laid(picture: UInt8, place: Placement, size: ImageSize, fill: int | None) -> UInt8:
    """(h, w, 3) the input's pixels, of the whole picture (H, W, 3)."""
    import cv2

    x, y = place.origin
    width, height = place.part
    part = picture[y : y + height, x : x + width]
    wanted = (round(width * place.scale[0]), round(height * place.scale[1]))
    if wanted != (width, height):
        # Linear as in the training of every family, although it aliases: means look foreign to it.
        part = np.asarray(cv2.resize(part, wanted, interpolation=cv2.INTER_LINEAR), np.uint8)
    if wanted == (size.width, size.height):
        return np.ascontiguousarray(part)
    whole = np.full((size.height, size.width, 3), 0 if fill is None else fill, np.uint8)
    left, top = place.offset
    whole[top : top + wanted[1], left : left + wanted[0]] = part
    return whole
