"""A page of black shapes and short texts, in millimetres from its top left corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64, check_array


@dataclass(frozen=True)
class Text:
    """A line of text.

    Args:
        x_mm: its left end; its middle where `centred`.
        y_mm: its base line.
        size_mm: height of the type.
        words: ASCII.
        centred: whether `x_mm` is its middle.
    """

    x_mm: float
    y_mm: float
    size_mm: float
    words: str
    centred: bool = False


@dataclass(frozen=True, eq=False)
class Page:
    """What is on a page.

    Args:
        width_mm: of the paper.
        height_mm: of the paper.
        rectangles_mm: (R, 4) float64: x, y, width, height.
        circles_mm: (C, 3) float64: x, y, radius.
        texts: lines of text.
        title: of the document.
    """

    width_mm: float
    height_mm: float
    rectangles_mm: Float64
    circles_mm: Float64
    texts: tuple[Text, ...] = ()
    title: str = ""

    def __post_init__(self) -> None:
        check_array("Page", "rectangles_mm", self.rectangles_mm, (None, 4), np.float64)
        check_array("Page", "circles_mm", self.circles_mm, (None, 3), np.float64)
