"""Ranges of hue as people write them, and pixels that have one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.text import NUMBER
from pseudolidar.geometry.grey import shift_to_8_bits
from pseudolidar.structures.arrays import Bool, Float32, Image

CIRCLE_DEG = 360.0
NAMED = {
    "red": (340.0, 15.0),
    "orange": (15.0, 42.0),
    "yellow": (42.0, 70.0),
    "green": (70.0, 165.0),
    "cyan": (165.0, 200.0),
    "blue": (200.0, 265.0),
    "purple": (265.0, 310.0),
    "pink": (310.0, 345.0),
}


@dataclass(frozen=True)
class Hues:
    """Hues from one to another, degrees, on the way up; through red where the first is larger.

    Args:
        from_deg: first, 0-360: 0 red, 120 green, 240 blue.
        to_deg: last.
    """

    from_deg: float
    to_deg: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `350-10`, or the name of a colour.

        Raises:
            UsageError: neither.
        """
        if text.lower() in NAMED:
            return cls(*NAMED[text.lower()])
        parts = [part.strip() for part in text.replace(":", "-").split("-")]
        if len(parts) == 2 and all(NUMBER.fullmatch(part) for part in parts):
            low, high = float(parts[0]), float(parts[1])
            if 0 <= low <= CIRCLE_DEG and 0 <= high <= CIRCLE_DEG and low != high:
                return cls(low, high)
        raise UsageError(
            f"{text!r}",
            want=f"hues such as 350-10, in degrees from 0 to 360, or one of {', '.join(NAMED)}",
        )

    def __str__(self) -> str:
        return f"{self.from_deg:g}-{self.to_deg:g}"

    def hold(self, hue_deg: Float32) -> Bool:
        """Where a hue is in the range."""
        if self.from_deg <= self.to_deg:
            return (hue_deg >= self.from_deg) & (hue_deg <= self.to_deg)
        return (hue_deg >= self.from_deg) | (hue_deg <= self.to_deg)


def unit_rgb(image: Image) -> Float32:
    """(H, W, 3) colours from 0 to 1; 16 bits are scaled by the bits that the picture uses."""
    full = 255 << shift_to_8_bits(image)
    return np.asarray(image, np.float32) / np.float32(full)
