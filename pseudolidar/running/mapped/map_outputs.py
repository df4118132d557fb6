"""Formats of a map, as a comma list."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from pseudolidar.errors import UsageError

KINDS, NOTHING = ("ply", "pcd", "npz", "bin"), "none"


@dataclass(frozen=True)
class MapOutputs:
    """Formats that a map is written in, or `none` for none.

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
        if not kinds or not set(kinds) <= set(KINDS) or len(set(kinds)) < len(kinds):
            raise UsageError(
                f"{text!r}", want=f"none, or a comma list, each once, of {', '.join(KINDS)}"
            )
        return cls(kinds)

    def __str__(self) -> str:
        return ",".join(self.kinds) or NOTHING
