"""One picture of a preview: photo, disparity and bird's-eye view with a caption."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.evaluation.pictures import NOTHING
from pseudolidar.geometry.grey import rgb_of
from pseudolidar.structures.arrays import UInt8

# Height of photo and disparity together, and so of the view from above; px.
HEIGHT_PX = 640
# A wide photo may be this wide at most; it is less high then.
WIDEST_PX = 960
CAPTION_PX, MARGIN_PX = 34, 4


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture with what it shows.

    Args:
        pixels: (H, W) or (H, W, 3) RGB uint8.
        label: in its corner.
        exact: pixels are not blended when it is resized: colours mean values.
    """

    pixels: UInt8
    label: str
    exact: bool = False


def side_of_view(photo_px: tuple[int, int] | None) -> int:
    """Side of the square view from above beside a photo of (width, height)."""
    return HEIGHT_PX if photo_px is None else 2 * _panel_px(photo_px)[1] + MARGIN_PX


def compose(panels: tuple[Panel, ...], view: Panel, caption: str) -> UInt8:
    """(H, W, 3) RGB: photo above disparity at the left, view from above at the right; even sizes.

    Args:
        panels: photo and disparity of one size; none for sources of clouds.
        view: seen from above, as large as `side_of_view` says.
        caption: below.
    """
    columns = [labelled(view.pixels, view.label)]
    if panels:
        height, width = panels[0].pixels.shape[:2]
        size_px = _panel_px((width, height))
        shown = [labelled(resized(panel, size_px), panel.label) for panel in panels]
        gap = np.full((MARGIN_PX, size_px[0], 3), NOTHING, np.uint8)
        columns.insert(0, np.vstack([shown[0], gap, *shown[1:]]))
        columns.insert(1, np.full((columns[0].shape[0], MARGIN_PX, 3), NOTHING, np.uint8))
    row = np.hstack(columns)
    bar = np.full((CAPTION_PX, row.shape[1], 3), NOTHING, np.uint8)
    write_on(bar, caption, (10, 23), 0.6)
    return even(np.vstack([row, bar]))


def _panel_px(photo_px: tuple[int, int]) -> tuple[int, int]:
    width, height = photo_px
    high = (HEIGHT_PX - MARGIN_PX) // 2
    wide = round(high * width / height)
    if wide > WIDEST_PX:
        wide, high = WIDEST_PX, max(round(WIDEST_PX * height / width), 1)
    return wide, high


def resized(panel: Panel, size_px: tuple[int, int]) -> UInt8:
    """(H, W, 3) RGB of a panel at (width, height)."""
    import cv2

    pixels = rgb_of(panel.pixels)
    shrinks = size_px[0] < pixels.shape[1]
    how = cv2.INTER_NEAREST if panel.exact else cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(
        cv2.resize(np.ascontiguousarray(pixels), size_px, interpolation=how), np.uint8
    )


def labelled(pixels: UInt8, label: str) -> UInt8:
    """A picture with a label in its upper left corner."""
    labelled = pixels.copy()
    write_on(labelled, label, (8, 18))
    return labelled


def even(picture: UInt8) -> UInt8:
    """With even width and height, as films need them."""
    height, width = picture.shape[:2]
    return np.ascontiguousarray(
        np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    )
