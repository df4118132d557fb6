"""Settings tried on the shown frame: at a reduced size first, then in full; the latest wins."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Generic, TypeVar

from pseudolidar.errors import PseudolidarError
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.arrays import Image
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.reel import SourceReel
from pseudolidar.viewer.tuning.reduced import (
    enlarged,
    parts_of_width,
    reduced,
    reduced_settings,
)
from pseudolidar.viewer.tuning.side_by_side import Convert, Shown, TunedReel, side_by_side
from pseudolidar.viewer.view import View

Job = TypeVar("Job")
# Settings that are kept loaded: what is tuned, its reduced form, and what was kept.
LOADED = 3


@dataclass(frozen=True)
class Workshop(Generic[Job]):
    """What there is to be tuned, and how frames are made by it.

    Args:
        job: settings of a verb.
        load: such settings to what makes something of a frame.
        sighted: such settings to what things in a frame are measured by.
    """

    job: Job
    load: Callable[[Job], Convert]
    sighted: Callable[[Job], Callable[[Frame], Seen]] | None = None

    def measuring(self, job: Job) -> Callable[[Frame], Seen] | None:
        """What things are measured by with such settings; None where they cannot be.

        It is loaded once, with the first frame that is asked about.
        """
        if self.sighted is None:
            return None
        loaded = functools.cache(functools.partial(self.sighted, job))
        return lambda frame: loaded()(frame)


@dataclass(frozen=True)
class Wanted(Generic[Job]):
    """What is to be shown.

    Args:
        job: present settings.
        kept: settings to compare them with; None where nothing is compared.
        shown: which of both.
    """

    job: Job
    kept: Job | None = None
    shown: Shown = "B"


@dataclass(frozen=True)
class Progress(Generic[Job]):
    """What has come of it.

    Args:
        wanted: what was asked for.
        matched_at: size of the pictures that were matched, as a share of theirs.
        seconds: since it was begun.
        refused: why nothing is made by these settings; "" where it is.
    """

    wanted: Wanted[Job]
    matched_at: float
    seconds: float
    refused: str = ""


class Tuner(Generic[Job]):
    """Tries settings on the shown frame of a view; those after it are made by them, too.

    Args:
        view: shows it.
        source: the frames by the first settings.
        workshop: how others are made.
        told: is told what has come of it, by the thread that did it.
    """

    def __init__(
        self,
        view: View,
        source: SourceReel,
        workshop: Workshop[Job],
        told: Callable[[Progress[Job]], None] = lambda _progress: None,
    ) -> None:
        self._view, self._source, self._workshop, self._told = view, source, workshop, told
        self._latest: Latest[Wanted[Job]] = Latest(self._try, name="viewer-tuning")
        self._loaded: list[tuple[Job, Remembering]] = []
        view.on_stop(self._latest.close)

    def ask(self, wanted: Wanted[Job]) -> None:
        """Show this, and nothing that was asked for before."""
        self._latest.ask(wanted)

    def idle(self, timeout_s: float) -> bool:
        """Wait until all is shown; tells whether it is."""
        return self._latest.idle(timeout_s)

    def _try(self, wanted: Wanted[Job], overtaken: Callable[[], bool]) -> None:
        begun_s = time.perf_counter()

        def tell(matched_at: float, refused: str = "") -> None:
            seconds = time.perf_counter() - begun_s
            self._told(Progress(wanted, matched_at, seconds, refused))

        try:
            now = self._convert(wanted.job)
            kept = None if wanted.kept is None else self._convert(wanted.kept)
        except PseudolidarError as refusal:
            tell(1.0, str(refusal))
            return
        reel = TunedReel(
            self._source, now.convert, None if kept is None else kept.convert, wanted.shown
        )
        trial = self._view.try_out(reel)
        try:
            frame = self._frame(trial.index)
            if (first := self._first_look(wanted, frame)) is not None:
                self._view.present(trial, replace(first, index=trial.index), last=False)
                tell(first.matched_at)
                if overtaken():
                    return
            other = None if kept is None else kept(frame)
            moment = side_by_side(now(frame), other, wanted.shown)
        except PseudolidarError as fault:
            moment = Moment(reel.ids[trial.index], trial.index, fault=str(fault))
        except BaseException:
            self._view.end(trial)
            raise
        self._view.present(trial, replace(moment, index=trial.index), last=True)
        tell(1.0)

    def _convert(self, job: Job) -> Remembering:
        """What makes frames by such settings; those that were not used for longest are let go."""
        known = next((convert for known, convert in self._loaded if known == job), None)
        convert = Remembering(self._workshop.load(job)) if known is None else known
        others = [each for each in self._loaded if each[1] is not convert]
        self._loaded = [(job, convert), *others[: LOADED - 1]]
        return convert

    def _frame(self, index: int) -> StereoFrame:
        """The shown frame, without reading it again; notes of its conversion are not its own."""
        moment = self._view.moment
        if moment is not None and moment.index == index and moment.converted is not None:
            frame = moment.converted.frame
        else:
            frame = self._source.source.load(index)
        assert isinstance(frame, StereoFrame)
        return replace(frame, notes=())

    def _first_look(self, wanted: Wanted[Job], frame: StereoFrame) -> Moment | None:
        """The frame matched at a reduced size; None where that is of no use."""
        parts = parts_of_width(frame.size_px[0])
        if parts == 1 or wanted.shown == "A" or self._convert(wanted.job).knows(frame):
            return None
        kept = None if wanted.kept is None else self._convert(wanted.kept)
        other = kept(frame) if kept is not None and kept.knows(frame) else None
        try:
            small = self._convert(reduced_job(wanted.job, parts))(reduced(frame, parts))
        except PseudolidarError:  # too small for the settings; the whole frame tells whether it is
            return None
        moment = side_by_side(enlarged(small, frame), other, wanted.shown)
        return replace(moment, matched_at=1 / parts)


def reduced_job(job: Job, parts: int) -> Job:
    """Settings for a pair of reduced size: without the frames before, which are whole."""
    changed: dict[str, Any] = {
        field.name: reduced_settings(getattr(job, field.name), parts)
        for field in fields(job)  # type: ignore[arg-type] # a dataclass
        if field.name in ("matcher", "smooth", "fill")
    }
    return replace(job, **changed, temporal=None)  # type: ignore[type-var]


class Remembering:
    """A conversion that knows what became of the last pair.

    Args:
        convert: a frame to what is made of it.
    """

    def __init__(self, convert: Convert) -> None:
        self.convert = convert
        self._last: tuple[Image, Converted] | None = None

    def knows(self, frame: StereoFrame) -> bool:
        """Whether it was the last."""
        return self._last is not None and self._last[0] is frame.left

    def __call__(self, frame: StereoFrame) -> Converted:
        """Convert it; the last one is not converted again."""
        if self._last is None or self._last[0] is not frame.left:
            self._last = frame.left, self.convert(frame)
        return self._last[1]
