"""Lines and labels in a picture: lines of any place, labels where there is room."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.evaluation.free_place import Places, Rectangle
from pseudolidar.structures.arrays import Float64, UInt8

# Fixed-point digits of OpenCV's drawing, and the largest coordinate that it is given, px.
SHIFT, FARTHEST_PX = 4, 30_000.0
TEXT_SIZE, LINE_PX, PAD_PX = 0.42, 15, 3
# A label's ground is darkened to this share.
GROUND = 0.35
# A line leads to a label that is farther off than this, px.
LEADER_PX = 8


def draw_lines(
    picture: UInt8,
    lines: Sequence[tuple[Float64, Float64]],
    colour: tuple[int, int, int],
    thick: int,
) -> None:
    """Draw smooth lines of one colour.

    Args:
        picture: (H, W, 3) RGB, changed.
        lines: both ends of each, (2,) px; they may lie outside.
        colour: red, green, blue.
        thick: width, px.
    """
    import cv2

    for a, b in lines:
        cv2.line(picture, _fixed(a), _fixed(b), colour, thick, cv2.LINE_AA, SHIFT)


def _fixed(point: Float64) -> tuple[int, int]:
    x, y = np.rint(np.clip(point, -FARTHEST_PX, FARTHEST_PX) * 2**SHIFT)
    return int(x), int(y)


def draw_label(
    picture: UInt8,
    places: Places,
    lines: Sequence[str],
    beside: Rectangle,
    colour: tuple[int, int, int],
    *,
    size: float = TEXT_SIZE,
) -> None:
    """Write lines on darkened ground where there is room; nothing where there is none.

    Args:
        picture: (H, W, 3) RGB, changed.
        places: that are free in it.
        lines: of text.
        beside: what they belong to.
        colour: of that, red, green, blue.
        size: of the text, as `write_on` has it.
    """
    import cv2

    font = cv2.FONT_HERSHEY_SIMPLEX
    widths = [cv2.getTextSize(line, font, size, 1)[0][0] for line in lines]
    width, height = max(widths) + 2 * PAD_PX, len(lines) * LINE_PX + PAD_PX
    place = places.take((width, height), beside)
    if place is None:
        return
    left, top = place
    ground = picture[top : top + height, left : left + width]
    ground[:] = (ground * GROUND).astype(np.uint8)
    _leader(picture, (left, top, left + width, top + height), beside, colour)
    picture[top : top + height, left : left + 2] = colour
    for row, line in enumerate(lines, start=1):
        write_on(picture, line, (left + PAD_PX + 1, top + row * LINE_PX - 3), size)


def _leader(
    picture: UInt8, label: Rectangle, beside: Rectangle, colour: tuple[int, int, int]
) -> None:
    """A line from a label to what it belongs to, where they are apart."""
    import cv2

    above, below = beside[1] - label[3], label[1] - beside[3]
    if max(above, below) <= LEADER_PX:
        return
    x = min(max(label[0], (beside[0] + beside[2]) // 2), label[2])
    begin, end = (label[3], beside[1]) if above > 0 else (label[1], beside[3])
    cv2.line(picture, (x, begin), ((beside[0] + beside[2]) // 2, end), colour, 1, cv2.LINE_AA)
