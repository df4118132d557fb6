"""A rectified pair side by side, with lines that must meet the same things in both."""

from __future__ import annotations

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.geometry.grey import shift_to_8_bits
from pseudolidar.structures.arrays import Bool, Image, UInt8
from pseudolidar.structures.frame import PairMask

# Lines over the height of a picture, and their colours in turn: legible on any ground.
LINES = 18
COLOURS = ((255, 80, 60), (60, 220, 90), (80, 150, 255), (255, 210, 40))
OUTLINE = (255, 0, 255)
STRIP_PX = 26


def rows_picture(
    left: Image, right: Image, *, title: str, mask: PairMask | None = None, lines: int = LINES
) -> UInt8:
    """(H, 2 W, 3) RGB: both pictures with the same rows drawn through them.

    Args:
        left: (H, W) or (H, W, 3) rectified.
        right: the same.
        title: what is written above.
        mask: pixels that show something; their outline is drawn.
        lines: how many rows are drawn.
    """
    shift = shift_to_8_bits(left, right)
    eyes = [_rgb(eye, shift) for eye in (left, right)]
    if mask is not None:
        eyes = [_outlined(eyes[0], mask.left), _outlined(eyes[1], mask.right)]
    both = np.hstack(eyes)
    height = both.shape[0]
    for number, row in enumerate(np.linspace(0, height - 1, lines + 2)[1:-1]):
        both[round(row)] = COLOURS[number % len(COLOURS)]
    strip = np.full((STRIP_PX, both.shape[1], 3), 24, np.uint8)
    write_on(strip, title, (8, 18))
    return np.vstack([strip, both])


def _rgb(image: Image, shift: int) -> UInt8:
    eight = np.asarray(image >> shift, np.uint8)
    return np.repeat(eight[..., None], 3, axis=2) if eight.ndim == 2 else eight.copy()


def _outlined(picture: UInt8, seen: Bool) -> UInt8:
    import cv2

    edges, _ = cv2.findContours(seen.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(picture, edges, -1, OUTLINE, 1), np.uint8)
