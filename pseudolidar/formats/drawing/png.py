"""Pages as PNG that says how many pixels an inch it has. Texts are drawn in strokes."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from pseudolidar.formats.drawing.page import Page
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.structures.arrays import Float64, UInt8

MM_PER_INCH, INCHES_PER_M = 25.4, 1000 / 25.4
# Height of capitals of OpenCV's plain strokes at scale 1, px; of Helvetica in sizes of the type.
STROKE_PX, CAPITALS = 22.0, 0.72
# Bytes of the signature and of the first chunk, after which pHYs may stand.
HEAD = 8 + 4 + 4 + 13 + 4
WHITE = 255


def png_bytes(page: Page, dpi: int) -> bytes:
    """The page as a PNG file of `dpi` pixels an inch."""
    encoded = encode_png(page_pixels(page, dpi / MM_PER_INCH), 6)
    per_m = round(dpi * INCHES_PER_M)
    body = b"pHYs" + struct.pack(">IIB", per_m, per_m, 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    return encoded[:HEAD] + chunk + encoded[HEAD:]


def page_pixels(page: Page, pixels_per_mm: float) -> UInt8:
    """(H, W) grey pixels of a page; those that an edge crosses are shaded by what is covered."""
    width, height = (round(side * pixels_per_mm) for side in (page.width_mm, page.height_mm))
    light = shaded((height, width), page.rectangles_mm, page.circles_mm, pixels_per_mm)
    _write(light, page, pixels_per_mm)
    return light


def shaded(
    shape: tuple[int, int], rectangles: Float64, circles: Float64, pixels_per_unit: float
) -> UInt8:
    """(H, W) white with black rectangles (R, 4) and circles (C, 3), from the top left corner.

    Args:
        shape: (H, W) of the picture.
        rectangles: (R, 4) x, y, width, height, in the drawing's unit.
        circles: (C, 3) x, y, radius.
        pixels_per_unit: of the drawing.
    """
    light = np.ones(shape, np.float32)
    for x, y, wide, high in (rectangles * pixels_per_unit).tolist():
        columns, across = _covered(x, x + wide, shape[1])
        rows, down = _covered(y, y + high, shape[0])
        light[rows, columns] -= np.outer(down, across)
    for x, y, radius in (circles * pixels_per_unit).tolist():
        rows = slice(max(int(y - radius) - 2, 0), max(int(y + radius) + 3, 0))
        columns = slice(max(int(x - radius) - 2, 0), max(int(x + radius) + 3, 0))
        part = light[rows, columns]
        v, u = np.mgrid[0 : part.shape[0], 0 : part.shape[1]]
        off = np.hypot(u + columns.start + 0.5 - x, v + rows.start + 0.5 - y) - radius
        part -= np.clip(0.5 - off, 0.0, 1.0).astype(np.float32)
    return np.asarray(np.clip(np.round(WHITE * light), 0, WHITE), np.uint8)


def _covered(begin: float, end: float, count: int) -> tuple[slice, Float64]:
    """Pixels between two places, and the share of each that is covered."""
    first, last = max(int(np.floor(begin)), 0), min(int(np.ceil(end)), count)
    edges = np.clip(np.arange(first, max(last, first) + 1), begin, end)
    return slice(first, max(last, first)), np.diff(edges)


def _write(light: UInt8, page: Page, pixels_per_mm: float) -> None:
    import cv2

    font = cv2.FONT_HERSHEY_SIMPLEX
    for text in page.texts:
        scale = text.size_mm * CAPITALS * pixels_per_mm / STROKE_PX
        width = cv2.getTextSize(text.words, font, scale, 1)[0][0]
        x = text.x_mm * pixels_per_mm - (width / 2 if text.centred else 0)
        at = round(x), round(text.y_mm * pixels_per_mm)
        cv2.putText(light, text.words, at, font, scale, (0,), 1, cv2.LINE_AA)
