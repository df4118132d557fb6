"""Formats of a map, as a comma list."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from pseudolidar.errors import UsageError

CLOUDS, MCAP, NOTHING = ("ply", "pcd", "npz", "bin"), "mcap", "none"


@dataclass(frozen=True)
class MapOutputs:
    """Formats that a map is written in, and `mcap` for a recording; or `none`.

    Args:
        kinds: names in the order given.
    """

    kinds: tuple[str, ...] = ("ply",)

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `pcd,ply`, or `none`.

        Raises:
            UsageError: an unknown name, or one twice.
        """
        kinds = tuple(part.strip() for part in text.split(",") if part.strip())
        if kinds == (NOTHING,):
            return cls(())
        known = (*CLOUDS, MCAP)
        if not kinds or not set(kinds) <= set(known) or len(set(kinds)) < len(kinds):
            raise UsageError(
                f"{text!r}", want=f"none, or a comma list, each once, of {', '.join(known)}"
            )
        return cls(kinds)

    @property
    def clouds(self) -> tuple[str, ...]:
        """Formats of clouds."""
        return tuple(kind for kind in self.kinds if kind != MCAP)

    @property
    def recording(self) -> bool:
        """Whether an MCAP is asked for."""
        return MCAP in self.kinds

    def __str__(self) -> str:
        return ",".join(self.kinds) or NOTHING
