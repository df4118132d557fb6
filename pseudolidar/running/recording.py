"""The recording of a run: each frame appended once, whatever interruptions there were."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pseudolidar.running.identity import prologue, source_name
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

if TYPE_CHECKING:
    from pseudolidar.formats.mcap import McapLog
    from pseudolidar.formats.mcap_frame import FrameChunk
    from pseudolidar.formats.mcap_prolog import McapProlog


@dataclass(frozen=True)
class RecordingPlan:
    """What recording a run will make.

    Args:
        name: of the file, or None for no recording.
        prolog: what it says about itself.
    """

    name: str | None = None
    prolog: McapProlog | None = None

    @classmethod
    def of(cls, job: Any, source: FrameSequence[Frame], *, wanted: bool) -> Self:
        """A recording that has the source's name, or none unless it is `wanted`."""
        return cls(f"{source_name(source)}.mcap", prologue(job, source)) if wanted else cls()

    @property
    def names(self) -> tuple[str, ...]:
        """Files that it can leave, finished or not."""
        return () if self.name is None else (self.name, f"{self.name}.part")

    @contextlib.contextmanager
    def open(self, folder: Path, frames: Sequence[str]) -> Iterator[Recording]:
        """Begin or continue the recording; complete when the block ends without an error.

        A recording of an earlier run keeps its whole frames as far as they are the ones that this
        run will have, in order; everything after that is cut off.

        Args:
            folder: output folder.
            frames: names of the frames that it is to hold, in order.

        Raises:
            OutputError: it cannot be written.
            RecordingError: it does not read back as it should.
        """
        if self.name is None or self.prolog is None:
            yield Recording(None, frames)
            return
        from pseudolidar.formats.mcap import McapLog

        with McapLog(folder / self.name, self.prolog, committed=frames) as log:
            yield Recording(log, log.held)


class Recording:
    """A recording in progress, or nothing where none is wanted.

    Args:
        log: what frames are appended to.
        held: names of frames that need not be appended.
    """

    def __init__(self, log: McapLog | None, held: Sequence[str]) -> None:
        self._log, self.held = log, frozenset(held)

    def append(self, name: str, chunk: FrameChunk | None) -> None:
        """Make a frame durable, unless the recording holds it already."""
        if self._log is not None and chunk is not None and name not in self.held:
            self._log.append(chunk)
