"""Things that look like a picture: `template:bike.png`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import ImageFormat, UsageError
from pseudolidar.formats.pictures.alpha import read_alpha
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.geometry.grey import shift_to_8_bits
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.template_search import Pattern, Place, best_places, refined
from pseudolidar.structures.arrays import Bool, Image, UInt8
from pseudolidar.structures.box import Detection

# A template is at least so large, px, and has at least this contrast, grey levels.
LEAST_SIDE_PX, LEAST_CONTRAST = 6, 2.0
# Rows of a rectified pair agree to this, px.
ROWS_PX = 1
# In the other eye a thing looks a little different: its correlation may be so much lower.
OTHER_EYE = 0.8


@dataclass(frozen=True)
class Template:
    """What looks like a picture, larger or smaller; in both eyes where there are two.

    Args:
        image: the picture; where it has an alpha channel, only what is opaque is compared.
        least_score: correlation from which on it counts, 0-1.
        smallest: size to begin with, as a factor of the picture's.
        largest: size to end with.
        most: so many of the best.
        both_eyes: count only what the right eye sees on the same rows too.
        name: class that things get; one that is known has a usual size.
    """

    image: Path
    least_score: float = 0.75
    smallest: float = 0.5
    largest: float = 2.0
    most: int = 1
    both_eyes: bool = True
    name: str = "template"

    def __post_init__(self) -> None:
        if not 0 < self.least_score <= 1:
            raise UsageError(
                f"least_score {self.least_score}", want="above 0, to 1", where="least_score"
            )
        if not 0 < self.smallest <= self.largest:
            raise UsageError(
                f"smallest {self.smallest}, largest {self.largest}",
                want="0 < smallest <= largest",
                where="smallest",
            )
        if not self.most >= 1:
            raise UsageError(f"most {self.most}", want="1 or more", where="most")

    def load(self) -> TemplateFinder:
        """The detector.

        Raises:
            ImageMissing, ImageUnreadable, ImageTruncated, ImageFormat: the picture cannot be used.
        """
        pixels = read_image(self.image).pixels
        opaque = read_alpha(self.image)
        shown = pixels if opaque is None else pixels[opaque]
        if min(pixels.shape[:2]) < LEAST_SIDE_PX or not shown.size:
            raise ImageFormat(
                f"a template of {pixels.shape[1]}x{pixels.shape[0]} px",
                want=f"at least {LEAST_SIDE_PX} px a side, not all of it transparent",
                fix="Cut the thing out of a picture where it is larger.",
                path=self.image,
            )
        own = _bytes(pixels, shift_to_8_bits(pixels))
        if float((own if opaque is None else own[opaque]).std()) < LEAST_CONTRAST:
            raise ImageFormat(
                "a template of one colour",
                want="something that can be told from its surroundings",
                fix="Look for it by its colour: --detector colour:red.",
                path=self.image,
            )
        return TemplateFinder(self, own, opaque)


@dataclass(frozen=True, eq=False)
class TemplateMatch:
    """Where something looks like the template.

    Args:
        place: in the left eye.
        disparity_px: to the same in the right eye; None where there is one camera, or the right
            eye does not see it.
    """

    place: Place
    disparity_px: float | None


@dataclass(frozen=True, eq=False)
class TemplateFinder:
    """Finds what looks like a picture.

    Args:
        settings: how.
        pixels: (h, w) or (h, w, 3) the template.
        opaque: (h, w) what of it counts; None for all.
    """

    settings: Template
    pixels: UInt8
    opaque: Bool | None

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """What looks like the template, the most alike first; a weak match is none."""
        return tuple(self._detection(sight, match.place) for match in self.matches(sight))

    def matches(self, sight: Sight) -> tuple[TemplateMatch, ...]:
        """The same with what the right eye sees of them."""
        left, right = _eyes(sight)
        pattern = Pattern(self.pixels, self.opaque)
        if left.ndim == 2 or self.pixels.ndim == 2:
            left, pattern = _grey(left), Pattern(_grey(self.pixels), self.opaque)
            right = None if right is None else _grey(right)
        places = best_places(
            left,
            pattern,
            scales=(self.settings.smallest, self.settings.largest),
            least_score=self.settings.least_score,
            most=self.settings.most,
        )
        matches = [
            TemplateMatch(place, None if right is None else self._disparity(left, right, place))
            for place in (refined(left, pattern, place) for place in places)
        ]
        if right is None or not self.settings.both_eyes:
            return tuple(matches)
        return tuple(match for match in matches if match.disparity_px is not None)

    def _disparity(self, left: UInt8, right: UInt8, place: Place) -> float | None:
        """Between where the left eye sees the thing and where the right eye sees the same."""
        x, y = round(place.x), round(place.y)
        seen = left[y : y + place.height, x : x + place.width]
        pattern = Pattern(seen, Pattern(self.pixels, self.opaque).resized(place.scale).opaque)
        top = max(0, y - ROWS_PX)
        strip = right[top : y + place.height + ROWS_PX, : x + place.width]
        if float(seen.std()) < LEAST_CONTRAST or strip.shape[0] < seen.shape[0]:
            return None
        least = OTHER_EYE * self.settings.least_score
        found = best_places(strip, pattern, scales=(1.0, 1.0), least_score=least, most=1)
        return x - found[0].x if found else None

    def _detection(self, sight: Sight, place: Place) -> Detection:
        height, width = sight.image.shape[:2]
        right = min(width - 1.0, place.x + place.width - 1)
        bottom = min(height - 1.0, place.y + place.height - 1)
        mask = None
        if self.opaque is not None:
            opaque = Pattern(self.pixels, self.opaque).resized(place.scale).opaque
            assert opaque is not None
            x, y = round(place.x), round(place.y)
            mask = np.zeros((height, width), np.bool_)
            window = mask[y : y + place.height, x : x + place.width]
            window[:] = opaque[: window.shape[0], : window.shape[1]]
        box = (max(0.0, place.x), max(0.0, place.y), right, bottom)
        return Detection(self.settings.name, box, min(1.0, place.score), mask)


def _eyes(sight: Sight) -> tuple[UInt8, UInt8 | None]:
    if sight.right is None:
        return _bytes(sight.image, shift_to_8_bits(sight.image)), None
    shift = shift_to_8_bits(sight.image, sight.right)
    return _bytes(sight.image, shift), _bytes(sight.right, shift)


def _bytes(image: Image, shift: int) -> UInt8:
    return np.ascontiguousarray(image >> shift, dtype=np.uint8)


def _grey(image: UInt8) -> UInt8:
    import cv2

    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
