"""One picture of a film of obstacles: photo, disparity, depth and view from above.

It is made in two steps, as who is who is known only when the frames before have been seen: what
each frame shows (`composed`), and what is drawn into it (`finished`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.evaluation.obstacle_drawing import AboveView, draw_from_above, draw_in_photo
from pseudolidar.evaluation.pictures import NOTHING
from pseudolidar.evaluation.preview_picture import (
    CAPTION_PX,
    MARGIN_PX,
    Panel,
    even,
    labelled,
    resized,
)
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.obstacle import Obstacle

# The photo is as large as these allow, px.
WIDEST_PX, HIGHEST_PX = 1200, 540


@dataclass(frozen=True)
class Layout:
    """Where things are in the picture: the photo above two maps of half its width, the view beside.

    Args:
        photo_px: (width, height) of the photo at its own size.
    """

    photo_px: tuple[int, int]

    @property
    def scale(self) -> float:
        """Size of the photo in the picture in relation to its own."""
        return self.panel_px[0] / self.photo_px[0]

    @property
    def panel_px(self) -> tuple[int, int]:
        """(width, height) of the photo in the picture."""
        width, height = self.photo_px
        scale = min(WIDEST_PX / width, HIGHEST_PX / height)
        return round(width * scale) // 2 * 2, max(round(height * scale), 1)

    @property
    def map_px(self) -> tuple[int, int]:
        """(width, height) of each map."""
        width, height = self.panel_px
        half = (width - MARGIN_PX) // 2
        return half, max(round(height * half / width), 1)

    @property
    def side_px(self) -> int:
        """Side of the view from above."""
        return self.panel_px[1] + MARGIN_PX + self.map_px[1]


def composed(photo: Panel, maps: Sequence[Panel], view: Panel) -> UInt8:
    """(H, W, 3) RGB without anything drawn in, of even size.

    Args:
        photo: at its own size.
        maps: one or two of the same size: disparity, depth.
        view: from above, as large as `Layout.side_px` says.
    """
    layout = Layout((photo.pixels.shape[1], photo.pixels.shape[0]))
    (wide, high), (map_wide, map_high), side = layout.panel_px, layout.map_px, layout.side_px
    picture = np.full((side, wide + MARGIN_PX + side, 3), NOTHING, np.uint8)
    picture[:high, :wide] = resized(photo, layout.panel_px)
    for number, panel in enumerate(maps):
        left = number * (wide - map_wide)
        pixels = labelled(resized(panel, layout.map_px), panel.label)
        picture[high + MARGIN_PX :, left : left + map_wide] = pixels[:map_high]
    picture[:, wide + MARGIN_PX :] = view.pixels
    bar = np.full((CAPTION_PX, picture.shape[1], 3), NOTHING, np.uint8)
    return even(np.vstack([picture, bar]))


def finished(
    picture: UInt8,
    obstacles: Sequence[Obstacle],
    *,
    photo_px: tuple[int, int],
    K: Float64,
    ahead_m: float,
    caption: str,
) -> UInt8:
    """The picture with its obstacles drawn in.

    Args:
        picture: as `composed` made it.
        obstacles: in `camera_left`.
        photo_px: (width, height) of the photo at its own size.
        K: (3, 3) of the camera.
        ahead_m: how far the view from above reaches.
        caption: below.
    """
    layout = Layout(photo_px)
    (wide, high), side = layout.panel_px, layout.side_px
    drawn = picture.copy()
    draw_in_photo(drawn[:high, :wide], obstacles, K, scale=layout.scale)
    left = wide + MARGIN_PX
    draw_from_above(drawn[:side, left : left + side], obstacles, AboveView(side, ahead_m))
    write_on(drawn, caption, (10, side + 23), 0.6)
    return drawn
