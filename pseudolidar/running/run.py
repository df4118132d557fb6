"""One run of a job on its output folder: locked, journalled, interruptible, reported."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.folder import own_folder
from pseudolidar.running.journal import Journal
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.record import FileRecord, FrameRecord, OutputFile
from pseudolidar.running.results import RunResult, Stopwatch
from pseudolidar.running.signals import Stopped, StopSignals
from pseudolidar.running.stream import Done, Skipped
from pseudolidar.sources.source import FrameSource

Result = TypeVar("Result")


class Run:
    """A run in progress; use `Run.open`. The loop over the frames stays with the pipeline.

    Args:
        folder: output folder, owned by this run.
        journal: its journal.
        source: where the frames come from.
        on_error: what a bad frame does.
        signals: caught while the run lasts.
    """

    def __init__(
        self,
        folder: Path,
        journal: Journal,
        source: FrameSource,
        *,
        on_error: OnError,
        signals: StopSignals,
    ) -> None:
        self.folder, self.source = folder, source
        self._journal, self._on_error, self._signals = journal, on_error, signals
        self._watch = Stopwatch()
        self._stopped: Stopped | None = None

    @classmethod
    @contextlib.contextmanager
    def open(
        cls,
        folder: Path,
        settings: dict[str, Any],
        source: FrameSource,
        *,
        on_error: OnError = "skip",
        overwrite: bool = False,
    ) -> Iterator[Self]:
        """Take the folder, start or continue its journal, and catch signals until the block ends.

        Ctrl-C and SIGTERM end the block early, in order; `result` then tells so.

        Args:
            folder: output folder.
            settings: all that decides about the bytes of the results, plain JSON values.
            source: where the frames come from.
            on_error: what a bad frame does.
            overwrite: start anew, whatever the journal of the folder holds.

        Raises:
            OutputError: the folder cannot be written to.
            OutputLocked: another run is writing to it.
            OutputSettings: it holds a run with other settings.
        """
        with (
            own_folder(folder),
            Journal.open(folder, settings, overwrite=overwrite) as journal,
            StopSignals() as signals,
        ):
            run = cls(folder, journal, source, on_error=on_error, signals=signals)
            try:
                yield run
            except Stopped as stopped:
                run._stopped = stopped

    @property
    def committed(self) -> frozenset[str]:
        """Ids of frames that are done and durable."""
        return frozenset(self._journal.committed)

    def good(self, outcomes: Iterable[Done[Result] | Skipped]) -> Iterator[Done[Result]]:
        """The frames of `stream` that passed; the others are noted, as long as they are few.

        Raises:
            TooManyBadFrames: and what else `good_frames` raises.
        """
        total = len(self.source.ids)
        with FrameProgress(total, done=len(self._journal.committed)) as progress:

            def skipped(frame: Skipped) -> None:
                self._journal.commit(FrameRecord.of_skipped(frame))
                progress.skip()

            for frame in good_frames(
                outcomes, frames=total, on_error=self._on_error, skipped=skipped
            ):
                yield frame
                self._watch.lap(frame.cpu_s)
                progress.advance()

    def commit(
        self, frame: Done[Any], figures: dict[str, Any], files: Sequence[OutputFile] = ()
    ) -> None:
        """Make the files of a frame durable and note it; a signal waits until that is done.

        Raises:
            OutputError: the disk is full or gone; the frame is then not committed.
        """
        names = tuple(FileRecord(file.name, len(file.data), file.sha256) for file in files)
        with self._signals.held():
            self._journal.commit(FrameRecord(frame.id, frame.index, names, figures), files)

    def records(self) -> list[FrameRecord]:
        """What is known of every frame, of this run and those it continues."""
        return self._journal.records()

    def result(self) -> RunResult:
        """How the run ended, or stands."""
        return RunResult(
            self.source.summary,
            len(self.source.ids) + len(self.source.refused),
            tuple(self.records()),
            self._watch.frames,
            self._watch.as_dict(),
            self._stopped.exit_code if self._stopped else None,
        )
