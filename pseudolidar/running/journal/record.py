"""What the journal knows about a frame: its files, its figures, or why it was skipped."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

from pseudolidar.formats.checksum import crc32
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.folder import inside, stays_inside

_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True, eq=False)
class OutputFile:
    """A file of a frame before it is written, summed where it was made: in the worker.

    Args:
        name: place in the output folder, with /.
        data: all its bytes.
        crc32: of the data.
    """

    name: str
    data: bytes
    crc32: int

    @classmethod
    def of(cls, name: str, data: bytes) -> Self:
        """The file with its checksum."""
        return cls(name, data, crc32(data))


@dataclass(frozen=True)
class FileRecord:
    """A file that was committed.

    Args:
        name: place in the output folder, with /.
        size: bytes.
        crc32: of its bytes; tells damage, not malice.

    Raises:
        ValueError: the name leaves the output folder.
    """

    name: str
    size: int
    crc32: int

    def __post_init__(self) -> None:
        if not stays_inside(self.name):  # a journal is a file like any other: not to be trusted
            raise ValueError(f"{self.name!r} is not inside the folder")

    def is_whole(self, folder: Path) -> bool:
        """Whether the file in `folder` is still the one that was committed."""
        path = inside(folder, self.name)
        try:
            return path.stat().st_size == self.size and crc32_of(path) == self.crc32
        except OSError:
            return False


@dataclass(frozen=True)
class FrameRecord:
    """A frame that is done with.

    Args:
        id: the source's name of the frame.
        index: its position in the source; None for one that never had a pair.
        files: what was committed for it.
        figures: its statistics, plain JSON values.
        skipped: the error's fields, where it was skipped; None otherwise.
    """

    id: str
    index: int | None
    files: tuple[FileRecord, ...] = ()
    figures: dict[str, Any] = field(default_factory=dict)
    skipped: dict[str, Any] | None = None

    @classmethod
    def of_skipped(cls, frame: Skipped) -> Self:
        """Record of a frame that did not pass."""
        trace = {"trace": frame.trace} if frame.trace else {}
        return cls(frame.id, frame.index, skipped=frame.error.as_dict() | trace)

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """From what `as_dict` gave.

        Raises:
            KeyError, TypeError, ValueError: it is something else.
        """
        files = tuple(FileRecord(**file) for file in data["files"])
        return cls(data["id"], data["index"], files, dict(data["figures"]), data["skipped"])


def crc32_of(path: Path) -> int:
    """Checksum of a file."""
    value = 0
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            value = crc32(block, value)
    return value
