"""`compare --to pcd,together`: which clouds show the errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from pseudolidar.errors import UsageError
from pseudolidar.running.products.outputs import KINDS, MCAP, Outputs, folder_of

TOGETHER = "together"
NOTHING = "none"
COLUMN_KINDS = tuple(kind for kind in KINDS if kind != "bin")  # which has no column for errors


@dataclass(frozen=True)
class ComparedOutputs:
    """Clouds of a comparison, as a comma list, or `none`.

    `pcd`, `ply` and their forms, `npz` and `mcap` hold the stereo clouds coloured by their error,
    with a column `error_m`; `together` holds both clouds in a PLY, with a column `source`.

    Args:
        kinds: names in the order given.
    """

    kinds: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `pcd,together`.

        Raises:
            UsageError: nothing, an unknown name, or two forms of one format.
        """
        kinds = tuple(part.strip() for part in text.split(",") if part.strip())
        if kinds == (NOTHING,):
            return cls(())
        known = (*COLUMN_KINDS, MCAP, TOGETHER)
        folders = [folder_of(kind) for kind in kinds]
        if not kinds or not set(kinds) <= set(known) or len(set(folders)) < len(folders):
            raise UsageError(
                f"{text!r}",
                want=f"none, or a comma list, each format once, of {', '.join(known)}",
            )
        return cls(kinds)

    def __str__(self) -> str:
        return ",".join(self.kinds) or NOTHING

    @property
    def together(self) -> bool:
        """Whether both clouds in one file are asked for."""
        return TOGETHER in self.kinds

    @property
    def folders(self) -> tuple[str, ...]:
        """Folders in the output folder that are written to."""
        return (*self.coloured.folders, *([TOGETHER] if self.together else []))

    @property
    def coloured(self) -> Outputs:
        """The files and the recording of coloured clouds."""
        return Outputs(tuple(kind for kind in self.kinds if kind != TOGETHER))
