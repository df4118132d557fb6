"""What a worker makes of a frame: bytes to commit, and figures about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pseudolidar.running.journal.record import OutputFile

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.frame import FramePart


@dataclass(frozen=True, eq=False)
class Product:
    """The outputs of one frame, encoded.

    Args:
        files: its files.
        parts: its parts of the recording, by the ending of the file's name; none without one.
        figures: statistics, plain JSON values.
    """

    files: tuple[OutputFile, ...]
    parts: Mapping[str, FramePart] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Bytes on the disk."""
        parts_bytes = sum(part.nbytes for part in self.parts.values())
        return parts_bytes + sum(len(file.data) for file in self.files)
