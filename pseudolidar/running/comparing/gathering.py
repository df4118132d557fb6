"""All pairs of a source through a comparison: told alone, or committed to an output folder."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.comparing.gathered import Gathered, Judged, Missing, bare
from pseudolidar.running.comparing.pass_through import pass_through
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.nearness import Searching
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.results import RunResult
from pseudolidar.running.run import Run
from pseudolidar.running.signals import SIGNAL_EXIT_BASE, Stopped
from pseudolidar.running.stream import stream
from pseudolidar.sources.recognise import Source
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.frame import StereoFrame

Judging = Callable[[StereoFrame], Judged]


@dataclass(frozen=True)
class Doing:
    """How frames are done.

    Args:
        crew: by how many workers.
        on_error: what a bad frame does; a run with a folder has it in its settings.
        check: look at a few pairs first.
        searching: what disparities are looked for, if they are.
    """

    crew: CrewPlan
    on_error: OnError
    check: bool
    searching: Searching | None = None


def gather(
    source: FrameSequence[StereoFrame], per_frame: Judging, missing: Missing, doing: Doing
) -> Gathered:
    """Compare every frame and write nothing.

    Raises:
        ReferenceMissing: none of the first frames has a reference.
        TooManyBadFrames: as `good_frames`.
    """
    frames: list[ComparedFrame] = []

    def keep(judged: Judged) -> str | None:
        missing.see(judged.against)
        frames.extend([] if judged.compared is None else [judged.compared])
        return judged.against

    result = pass_through(
        source,
        per_frame,
        keep,
        crew=doing.crew,
        on_error=doing.on_error,
        check=doing.check,
        searching=doing.searching,
    )
    return Gathered(tuple(frames), result)


def gather_into(
    run: Run,
    source: FrameSequence[StereoFrame],
    per_frame: Judging,
    missing: Missing,
    doing: Doing,
    recording: RecordingPlan,
) -> None:
    """Compare the frames that are not done yet, and commit what is written of them in order.

    Raises:
        ReferenceMissing: none of the first frames has a reference.
        TooManyBadFrames: as `Run.good`.
    """
    empty = bare(run.records())
    names = [name for name in run.expected(per_frame, crew=doing.crew) if name not in empty]
    with recording.open(run.folder, names) as log:
        settled = run.settled(log.held | empty)
        run.check(
            wanted=doing.check and len(settled) < len(source.ids),
            crew=doing.crew,
            searching=doing.searching,
        )
        outcomes = stream(source, per_frame, crew=doing.crew, skip=settled, in_flight=run.in_flight)
        for frame in run.good(outcomes):
            judged = frame.value
            missing.see(judged.against)
            log.append(frame.id, judged.product.parts)
            run.commit(Done(frame.id, frame.index, judged.product, frame.cpu_s))


def ended_well(result: RunResult) -> RunResult:
    """The result of a run that no signal ended.

    Raises:
        Stopped: one did; errors have come out of the run by themselves.
    """
    if result.ended_by:
        raise Stopped(result.ended_by - SIGNAL_EXIT_BASE)
    return result


def taken_as_pairs(settings: Source) -> Source:
    """Of a recording its pairs, where it has some and nothing else is asked for."""
    if not isinstance(settings, Recording) or settings.take != "auto":
        return settings
    pairs = replace(settings, take="pairs")
    with contextlib.suppress(PseudolidarError):  # what it has then is said by its line
        pairs.open()
        return pairs
    return settings
