"""Times as people write them: 300s, 5m, 1h."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Self

from pseudolidar.errors import UsageError

_UNITS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_TEXT = re.compile(r"([0-9]+(?:\.[0-9]*)?)\s*([a-z]*)")


@dataclass(frozen=True)
class Duration:
    """A time.

    Args:
        seconds: of it.
    """

    seconds: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """`300`, `300s`, `5m`, `1.5h`.

        Raises:
            UsageError: it is no time, or none at all.
        """
        match = _TEXT.fullmatch(text.strip().lower())
        seconds = float(match[1]) * _UNITS.get(match[2], math.nan) if match else math.nan
        if not 0 < seconds < math.inf:
            raise UsageError(f"a time of {text!r}", want="such as 300s, 5m or 1h")
        return cls(seconds)

    def __str__(self) -> str:
        return f"{self.seconds:g}s"
