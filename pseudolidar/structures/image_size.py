"""The size of a picture as people write it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from pseudolidar.errors import UsageError


@dataclass(frozen=True)
class ImageSize:
    """A size as `640x384`, width first.

    Args:
        width: px.
        height: px.
    """

    width: int
    height: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `640x384`.

        Raises:
            UsageError: not two positive numbers.
        """
        parts = text.lower().split("x")
        if len(parts) != 2 or not all(p.isascii() and p.isdigit() and int(p) > 0 for p in parts):
            raise UsageError(f"{text!r}", want="a size such as 640x384, width first")
        return cls(int(parts[0]), int(parts[1]))

    def __str__(self) -> str:
        return f"{self.width}x{self.height}"
