"""The loop of a live run: what workers make of the newest pairs becomes durable, and is told."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from pseudolidar.calibration.boards.eye_order import EyeOrder
from pseudolidar.errors import CameraFault, OutputSettings
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.live.keys import keys
from pseudolidar.running.live.meter import Meter
from pseudolidar.running.live.new_views import NewViews
from pseudolidar.running.live.newest import Newest
from pseudolidar.running.live.preview import LIVE_NAME
from pseudolidar.running.live.saving import saved_pairs
from pseudolidar.running.live.table import LiveTable
from pseudolidar.running.networks import networks_of
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.running.products.product import Product
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.reports.live_report import LiveReport
from pseudolidar.running.run import Run
from pseudolidar.running.stream import live_stream
from pseudolidar.sources.capture.cameras import Capture
from pseudolidar.sources.capture.live_pairs import EveryInterval, LivePairs, OnRequest

# Which pairs are saved: those that a key asks for, by time, or by what is to be seen of a board.
Choice = OnRequest | EveryInterval | NewViews


class RecordSettings(Protocol):
    """What the settings of a live run say about its end and its outputs."""

    @property
    def out(self) -> Path:
        """Output folder."""

    @property
    def to(self) -> Outputs:
        """What is written of each frame."""

    @property
    def capture(self) -> Path | None:
        """Folder of pairs that are only saved."""

    @property
    def realtime(self) -> bool:
        """Videos are played as if live."""

    @property
    def seconds(self) -> float | None:
        """End after so many."""

    @property
    def crew(self) -> CrewPlan:
        """How the frames are done."""

    @property
    def on_error(self) -> OnError:
        """What a bad frame does."""

    @property
    def overwrite(self) -> bool:
        """Start anew."""


def record(
    job: RecordSettings,
    cameras: Capture,
    source: LivePairs[Any],
    per_frame: Callable[[Any], Product],
    recording: RecordingPlan,
    *,
    by: Choice | None = None,
    shown: Sequence[Newest[Any]] = (),
    eyes: Callable[[], EyeOrder] | None = None,
) -> LiveReport:
    """Write what workers make of the newest pairs, until the cameras end or somebody says so.

    Args:
        job: settings.
        cameras: which give the pairs.
        source: the pairs.
        per_frame: what is done to one.
        recording: which recordings are written.
        by: which pairs are saved, where they are only saved.
        shown: what looks at frames while the run goes on.
        eyes: which camera pairs say is the left one.
    """
    meter, views = Meter(cameras), by if isinstance(by, NewViews) else None
    actions, words = _pressable(cameras, by)
    products = (*recording.names, LIVE_NAME)

    def told() -> dict[str, Any]:
        board = {} if views is None else {"board": views.as_dict()}
        order = {} if eyes is None else {"eyes": eyes()}
        return {"live": meter.figures.as_dict() | board | order}

    with (
        keys(actions) as pressed,
        Run.open(
            job.out,
            job,
            source,
            products=products,
            stop=cameras.stop,
            tell=told,
            networks=networks_of(per_frame),
        ) as run,
    ):
        before = _held_before(job, run, source)
        if views is not None:
            views.remember(saved_pairs(job.out, before))
        lost: CameraFault | None = None
        with (
            recording.open(job.out, before) as log,
            LiveTable(meter, words if pressed else "", words_of(by)) as table,
            contextlib.ExitStack() as looking,
        ):
            for one in shown:
                looking.enter_context(one)
            cameras.begin()
            meter.begin()
            if job.seconds is not None:
                cameras.end_after(job.seconds)
            outcomes = live_stream(source, per_frame, crew=job.crew, in_flight=run.in_flight)
            try:
                for frame in run.good_live(outcomes, table):
                    with run.held():
                        log.append(frame.id, frame.value.parts)
                        run.commit(_timed(frame, meter.done(source.taken_ns(frame.index))))
            except CameraFault as fault:  # the recording is completed all the same
                lost = fault
        if lost is not None:
            raise lost
    text = "" if views is None else views.words
    return LiveReport(run.result(), meter.figures, job.out, _to_open(job, recording), text)


def _pressable(cameras: Capture, by: Choice | None) -> tuple[dict[str, Callable[[], None]], str]:
    """What keys do, by character, and the same in words."""
    if isinstance(by, OnRequest):
        saving = {" ": by.request, "\n": by.request}
        return {"q": cameras.stop, **saving}, "space saves a pair, q ends"
    return {"q": cameras.stop}, "q ends"


def _to_open(job: RecordSettings, recording: RecordingPlan) -> tuple[Path, ...]:
    """What there is to open: folders of files and recordings, else the output folder."""
    opens = [job.out / folder for folder in job.to.folders if job.capture is None]
    opens += [job.out / name for name in recording.names]
    results = tuple(path for path in opens if path.exists()) or (job.out,)
    picture = job.out / LIVE_NAME
    return (*results, picture) if picture.exists() else results


def words_of(by: Choice | None) -> Callable[[], str] | None:
    """What whoever chooses pairs has to say at any moment; None for nothing."""
    return (lambda: by.words) if isinstance(by, NewViews) else None


def _timed(frame: Done[Product], latency_s: float) -> Done[Product]:
    """The frame with its latency among its figures."""
    figures = frame.value.figures | {"latency_s": round(latency_s, 4)}
    return replace(frame, value=replace(frame.value, figures=figures))


def _held_before(job: RecordSettings, run: Run, source: LivePairs[Any]) -> tuple[str, ...]:
    """Number new frames after those of an earlier run in the folder; ids of its finished ones.

    Raises:
        OutputSettings: videos would begin anew behind what is there.
    """
    records = run.records()
    if records and job.realtime:
        raise OutputSettings(
            f"the folder holds {len(records)} frames already, and videos begin anew",
            want="an empty folder, or cameras, which add to it",
            fix="Choose another output folder, or pass --overwrite.",
            path=job.out,
        )
    numbers = [record.index for record in records if record.index is not None]
    source.go_on_after(max(numbers, default=-1) + 1)
    return tuple(record.id for record in records if record.skipped is None)
