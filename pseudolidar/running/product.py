"""What a worker makes of a frame: bytes to commit, and figures about them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pseudolidar.running.record import OutputFile

if TYPE_CHECKING:
    from pseudolidar.formats.mcap_frame import FrameChunk


@dataclass(frozen=True, eq=False)
class Product:
    """The outputs of one frame, encoded.

    Args:
        files: its files.
        chunk: its part of the recording, where there is one.
        figures: statistics, plain JSON values.
    """

    files: tuple[OutputFile, ...]
    chunk: FrameChunk | None = None
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Bytes on the disk."""
        chunk_bytes = 0 if self.chunk is None else self.chunk.nbytes
        return chunk_bytes + sum(len(file.data) for file in self.files)
