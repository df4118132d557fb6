"""One run of a job on its output folder: locked, journalled, interruptible, reported."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

from pseudolidar.errors import ALL_DONE, OutputError, PseudolidarError, printable
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Done, Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.crew.in_flight import InFlight, noting
from pseudolidar.running.folder import own_folder
from pseudolidar.running.journal.identity import identity
from pseudolidar.running.journal.journal import Journal
from pseudolidar.running.journal.record import FileRecord, FrameRecord
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import preflight
from pseudolidar.running.products.product import Product
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.results import RunResult, Stopwatch, write_results
from pseudolidar.running.signals import SIGNAL_EXIT_BASE, Stopped, StopSignals
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

Result = TypeVar("Result")
_log = logging.getLogger(__name__)


class RunSettings(Protocol):
    """What every pipeline's settings have."""

    @property
    def on_error(self) -> OnError:
        """What a bad frame does."""

    @property
    def overwrite(self) -> bool:
        """Start anew, whatever the journal of the output folder holds."""


class Progress(Protocol):
    """Shows how a run goes."""

    def advance(self) -> None:
        """One more frame is committed."""

    def skip(self) -> None:
        """One more frame is skipped."""


class Run:
    """A run in progress; use `Run.open`. The loop over the frames stays with the pipeline.

    Args:
        folder: output folder, owned by this run.
        journal: its journal.
        source: where the frames come from.
        in_flight: where frames are noted while they are done.
        decided_by: what decides the results, as `identity` has it.
        on_error: what a bad frame does.
        signals: caught while the run lasts.
    """

    def __init__(
        self,
        folder: Path,
        journal: Journal,
        source: FrameSequence[Frame],
        in_flight: InFlight,
        *,
        decided_by: Mapping[str, Any],
        on_error: OnError,
        signals: StopSignals,
    ) -> None:
        self.folder, self.source, self.in_flight = folder, source, in_flight
        self.decided_by = decided_by
        self._journal, self._on_error, self._signals = journal, on_error, signals
        self._watch = Stopwatch()
        self._ended_by, self._halted_by = 0, 0
        self._hopeless: frozenset[str] = frozenset()
        self._warnings: tuple[str, ...] = ()
        self._tell: Callable[[], Mapping[str, Any]] = dict

    @classmethod
    @contextlib.contextmanager
    def open(
        cls,
        folder: Path,
        job: RunSettings,
        source: FrameSequence[Frame],
        *,
        products: Sequence[str] = (),
        stop: Callable[[], None] | None = None,
        tell: Callable[[], Mapping[str, Any]] = dict,
        networks: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> Iterator[Self]:
        """Take the folder, start or continue its journal, and catch signals until the block ends.

        Ctrl-C and SIGTERM end the block early, in order; `result` then tells so. However it ends,
        `run.json` and `report.json` are written.

        Args:
            folder: output folder.
            job: settings of the pipeline.
            source: where the frames come from.
            products: names of the files that belong to no single frame, for `--overwrite`.
            stop: ends the source by itself; a first signal calls it, and the block goes on to its
                end. None for sources that are finished another time.
            tell: figures of the run that are of no single frame, for `run.json`.
            networks: those that frames are done by, as `networks_of` has them, for `run.json`; a
                run that continues needs the same.

        Raises:
            OutputError: the folder cannot be written to.
            OutputLocked: another run is writing to it.
            OutputSettings: it holds a run with other settings.
        """
        decided_by = identity(job, source, networks)
        with (
            own_folder(folder),
            Journal.open(folder, decided_by, products=products, overwrite=job.overwrite) as journal,
            noting(folder) as in_flight,
            StopSignals(stop) as signals,
        ):
            run = cls(
                folder,
                journal,
                source,
                in_flight,
                decided_by=decided_by,
                on_error=job.on_error,
                signals=signals,
            )
            run._tell = tell if not networks else lambda: {"networks": networks, **tell()}
            try:
                yield run
                run._ended_by = SIGNAL_EXIT_BASE + signals.told if signals.told else ALL_DONE
            except Stopped as stopped:
                run._ended_by = stopped.exit_code
            except PseudolidarError as error:
                run._ended_by = error.exit_code
                with contextlib.suppress(OutputError):  # the first one is the one to tell
                    write_results(folder, run.result(), job)
                raise
            write_results(folder, run.result(), job)

    def expected(
        self, per_frame: Callable[[Any], Any], *, crew: CrewPlan | None = None
    ) -> tuple[str, ...]:
        """Ids of the frames that the results will hold: all but those that failed and fail again.

        Frames that an earlier run skipped are tried here and thrown away, before anything is
        written: one that was mended belongs between frames that a recording may hold already.
        """
        failed = {record.id for record in self._journal.records() if record.skipped is not None}
        others = frozenset(self.source.ids) - failed
        outcomes = stream(self.source, per_frame, crew=crew, skip=others) if failed else ()
        self._hopeless = frozenset(o.id for o in outcomes if isinstance(o, Skipped))
        return tuple(name for name in self.source.ids if name not in self._hopeless)

    def check(self, *, wanted: bool, crew: CrewPlan, searching: Searching | None = None) -> None:
        """Look at a few pairs before the first frame; what is odd goes into the report.

        Args:
            wanted: whether to look at all.
            crew: how.
            searching: what disparities the run looks for, if it does.

        Raises:
            PairSwapped, NotRectified, CalibrationSizeMismatch: they would make no metres.
        """
        self._warnings = preflight(
            self.source,
            wanted=wanted,
            crew=crew,
            in_flight=self.in_flight,
            searching=searching,
        )

    def warn(self, lines: Iterable[str]) -> None:
        """Say what is odd about the run as a whole: in the log now, and in the report.

        Args:
            lines: one warning each.
        """
        for line in lines:
            _log.warning("%s", printable(line))
            self._warnings = (*self._warnings, line)

    @property
    def committed(self) -> frozenset[str]:
        """Ids of the frames whose files are whole."""
        return frozenset(self._journal.committed)

    def settled(self, held: Collection[str]) -> frozenset[str]:
        """Ids of frames that need not be done: committed and `held`, or hopeless.

        Args:
            held: frames that the recording has.
        """
        return self._hopeless | (self._journal.committed & frozenset(held))

    def good(
        self, outcomes: Iterable[Done[Result] | Skipped], *, again: int = 0
    ) -> Iterator[Done[Result]]:
        """The frames of `stream` that passed; the others are noted, as long as they are few.

        Args:
            outcomes: of `stream`.
            again: how many of the committed frames are among them, to be gone through once more.

        Raises:
            TooManyBadFrames: and what else `good_frames` raises.
        """
        total = len(self.source.ids)
        with FrameProgress(total, done=len(self._journal.committed) - again) as progress:
            yield from self._good(outcomes, total, progress)

    def good_live(
        self, outcomes: Iterable[Done[Result] | Skipped], progress: Progress
    ) -> Iterator[Done[Result]]:
        """The same for cameras: nobody knows how many frames there will be, so none are too many.

        Args:
            outcomes: of `live_stream`.
            progress: what shows how it goes.

        Raises:
            PseudolidarError: as `good_frames`.
        """
        yield from self._good(outcomes, 0, progress)

    def _good(
        self, outcomes: Iterable[Done[Result] | Skipped], total: int, progress: Progress
    ) -> Iterator[Done[Result]]:
        def skipped(frame: Skipped) -> None:
            with self._signals.held():
                self._journal.commit(FrameRecord.of_skipped(frame))
            progress.skip()

        for frame in good_frames(outcomes, frames=total, on_error=self._on_error, skipped=skipped):
            try:
                yield frame
            except GeneratorExit:
                if self._halted_by:  # the frame that the loop was left at is done too
                    self._watch.lap(frame.cpu_s)
                raise
            self._watch.lap(frame.cpu_s)
            progress.advance()

    def halt(self, exit_code: int) -> None:
        """What was to be watched for has come: the loop ends here, and stays ended.

        Args:
            exit_code: that tells so.
        """
        self._halted_by = exit_code

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """A block that a first signal does not cut, such as one frame of several files."""
        with self._signals.held():
            yield

    def commit(self, frame: Done[Product]) -> None:
        """Make the files of a frame durable and note it; a signal waits until that is done.

        Raises:
            OutputError: the disk is full or gone; the frame is then not committed.
        """
        files, figures = frame.value.files, frame.value.figures
        names = tuple(FileRecord(file.name, len(file.data), file.crc32) for file in files)
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
            self._ended_by,
            self._warnings,
            self._tell(),
            self._halted_by,
        )
