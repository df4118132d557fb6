"""Things of one colour: the red or blue object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ImageFormat, UsageError
from pseudolidar.obstacles.hues import Hues, unit_rgb
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.spots import Spot, spots_of
from pseudolidar.obstacles.subpixel_edges import edges_px
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Image
from pseudolidar.structures.box import Detection


@dataclass(frozen=True)
class Colour:
    """The largest things of one colour.

    Args:
        hues: range of hue in degrees, 350-10, or red, orange, yellow, green, cyan, blue, purple,
            pink.
        least_saturation: 0 (grey) to 1.
        least_value: brightness, 0 (black) to 1; darker pixels have no hue that means anything.
        most: so many of the largest.
        least_pixels: that a thing has.
        opening: specks and bridges narrower than this are removed, px; 1 keeps all.
        closing: gaps narrower than this are filled, px; 1 keeps all.
        name: class that things get; one that is known has a usual size.
    """

    hues: Hues
    least_saturation: float = 0.5
    least_value: float = 0.2
    most: int = 1
    least_pixels: int = 30
    opening: int = 3
    closing: int = 5
    name: str = "colour"

    def __post_init__(self) -> None:
        for name in ("least_saturation", "least_value"):
            if not 0 <= getattr(self, name) <= 1:
                raise UsageError(f"{name} {getattr(self, name)}", want="0 to 1", where=name)
        for name in ("most", "least_pixels", "opening", "closing"):
            if not getattr(self, name) >= 1:
                raise UsageError(f"{name} {getattr(self, name)}", want="1 or more", where=name)

    def load(self) -> ColouredThings:
        """The detector."""
        return ColouredThings(self)


@dataclass(frozen=True)
class ColouredThings:
    """Finds things of a colour.

    Args:
        settings: which, and how large.
    """

    settings: Colour

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """Things of the colour, the largest first, with their pixels and edges to sub-pixels.

        The score is the share of a thing's pixels that have the colour themselves.

        Raises:
            ImageFormat: the picture is grey.
        """
        if sight.image.ndim == 2:
            raise ImageFormat(
                "a grey picture",
                want="colours",
                fix="Take the colour cameras, or another detector: --detector cloud.",
                where=f"frame {sight.id}",
            )
        own = self._coloured(sight.image)
        spots = sorted(self._spots(own), key=lambda spot: -spot.pixels)[: self.settings.most]
        rgb = unit_rgb(sight.image)
        return tuple(self._detection(spot, own, rgb) for spot in spots)

    def _coloured(self, image: Image) -> Bool:
        import cv2

        hsv = np.asarray(cv2.cvtColor(unit_rgb(image), cv2.COLOR_RGB2HSV), np.float32)
        inside = self.settings.hues.hold(hsv[:, :, 0])
        inside &= hsv[:, :, 1] >= self.settings.least_saturation
        inside &= hsv[:, :, 2] >= self.settings.least_value
        return inside

    def _spots(self, own: Bool) -> list[Spot]:
        import cv2

        def disc(size: int) -> AnyArray:
            return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))

        opened = cv2.morphologyEx(own.astype(np.uint8), cv2.MORPH_OPEN, disc(self.settings.opening))
        closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, disc(self.settings.closing))
        _, numbers = cv2.connectedComponents(closed, connectivity=8)
        return [
            spot
            for spot in spots_of(numbers.astype(np.int64))
            if spot.pixels >= self.settings.least_pixels
        ]

    def _detection(self, spot: Spot, own: Bool, rgb: Float32) -> Detection:
        coloured = own[spot.rows, spot.columns] & spot.inside
        mask = np.zeros(own.shape, np.bool_)
        mask[spot.rows, spot.columns] = spot.inside
        score = np.count_nonzero(coloured) / spot.pixels
        return Detection(self.settings.name, edges_px(mask, spot, rgb), score, mask)
