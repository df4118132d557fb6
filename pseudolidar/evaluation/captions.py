"""Text on pictures, legible on any ground."""

from __future__ import annotations

from pseudolidar.structures.arrays import UInt8

INK, EDGE = (235, 235, 235), (0, 0, 0)
_AROUND = tuple((x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0))


def write_on(picture: UInt8, text: str, place: tuple[int, int], size: float = 0.45) -> None:
    """Write light text with a dark edge into `picture`; the font has ASCII alone.

    Args:
        picture: (H, W, 3), changed.
        text: what to write.
        place: (x, y) of the lower left corner, px.
        size: 1 is about 22 px high.
    """
    import cv2

    plain = text.encode("ascii", "replace").decode()
    font, line = cv2.FONT_HERSHEY_SIMPLEX, cv2.LINE_AA
    for x, y in _AROUND:
        cv2.putText(picture, plain, (place[0] + x, place[1] + y), font, size, EDGE, 1, line)
    cv2.putText(picture, plain, place, font, size, INK, 1, line)
