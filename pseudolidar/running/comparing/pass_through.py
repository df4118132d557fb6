"""All frames of a source through some work, with nothing written of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.comparing.gathered import AGAINST
from pseudolidar.running.crew.attempt import AnyFrame, NewResult, Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import preflight
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.results import RunResult, Stopwatch
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSequence


def pass_through(
    source: FrameSequence[AnyFrame],
    per_frame: Callable[[AnyFrame], NewResult],
    keep: Callable[[NewResult], str | None],
    *,
    crew: CrewPlan,
    on_error: OnError,
    check: bool,
    searching: Searching | None = None,
) -> RunResult:
    """Do every frame and hand the results over in order.

    Args:
        source: the frames.
        per_frame: pure function of a frame.
        keep: takes a result, and says what its frame was compared with, if it was.
        crew: how the frames are done.
        on_error: what a bad frame does.
        check: look at a few pairs first.
        searching: what disparities are looked for, if they are.

    Returns:
        Frames and times, as of a run that has an output folder.
    """
    source_of_any: FrameSequence[Any] = source
    warnings = preflight(source_of_any, wanted=check, crew=crew, searching=searching)
    records, watch, total = list[FrameRecord](), Stopwatch(), len(source.ids)
    with FrameProgress(total) as progress:

        def skip(frame: Skipped) -> None:
            records.append(FrameRecord.of_skipped(frame))
            progress.skip()

        outcomes = stream(source, per_frame, crew=crew)
        for frame in good_frames(outcomes, frames=total, on_error=on_error, skipped=skip):
            figures = {AGAINST: keep(frame.value)}
            records.append(FrameRecord(frame.id, frame.index, figures=figures))
            watch.lap(frame.cpu_s)
            progress.advance()
    return RunResult(
        source.summary,
        total + len(source.refused),
        tuple(records),
        watch.frames,
        watch.as_dict(),
        warnings=warnings,
    )
