"""Ordered, bounded, parallel passage of a source's frames through per-frame work.

Threads by default, because decoding, matching and encoding happen in native code that releases the
GIL. One frame uses one thread: with a frame for every core nothing is gained by splitting one, and
OpenCV's own pool would only fight for the cores. While a stream runs, OpenCV is therefore set to
one thread.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from itertools import count, islice
from typing import Any

from pseudolidar.errors import CaptureEnded
from pseudolidar.running.crew.attempt import AnyFrame, Done, NewResult, Skipped
from pseudolidar.running.crew.crew import Crew
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.crew.in_flight import InFlight
from pseudolidar.running.memory import keep_freed_memory
from pseudolidar.sources.capture.live_pairs import LivePairs
from pseudolidar.sources.source import FrameSequence

# Frames in flight per worker: one that is worked on and one that is finished or waits, so that
# neither a slow neighbour nor a slow disk makes a worker stop. Memory is this times a frame.
IN_FLIGHT_PER_WORKER = 2


def stream(
    source: FrameSequence[AnyFrame],
    per_frame: Callable[[AnyFrame], NewResult],
    *,
    crew: CrewPlan | None = None,
    skip: Collection[str] = (),
    in_flight: InFlight | None = None,
) -> Iterator[Done[NewResult] | Skipped]:
    """Pass each frame of `source` through `per_frame`, in parallel, and yield results in order.

    A frame that fails, or does not end, is yielded as `Skipped` and ends nothing. The number of
    frames in flight is bounded, so memory does not grow with the sequence. Results do not depend on
    `crew`.

    Args:
        source: what to read; `source.load(index)` is called in the workers.
        per_frame: pure function of a frame.
        crew: how many workers of which kind; None for a thread per core.
        skip: ids that are left out (committed before).
        in_flight: where the frames are noted that could take this process with them.

    Raises:
        UsageError: the crew shall be processes, and the work cannot be sent to one.

    Yields:
        First what the source refused when it was opened, then every other frame by index.
    """
    yield from (Skipped(name, None, error) for name, error in source.refused)
    crew = crew or CrewPlan()
    wanted = [index for index, name in enumerate(source.ids) if name not in skip]
    hired = crew.crew(source, per_frame, frames=len(wanted), in_flight=in_flight)
    yield from _passed(source, hired, wanted, ahead=IN_FLIGHT_PER_WORKER * crew.count)


def live_stream(
    source: LivePairs[Any],
    per_frame: Callable[[Any], NewResult],
    *,
    crew: CrewPlan,
    in_flight: InFlight | None = None,
) -> Iterator[Done[NewResult] | Skipped]:
    """The same for cameras, until they end: a worker that is free takes the newest pair.

    No pair waits for a worker, so that results do not lag behind: there are as many in flight as
    there are workers.

    Args:
        source: the cameras.
        per_frame: a frame to its result.
        crew: how frames are done.
        in_flight: where the frames are noted that could take this process with them.

    Raises:
        CameraFault, EyesApart: what ended the cameras, after the frames that were taken before.
    """
    hired = crew.crew(source, per_frame, frames=crew.count, in_flight=in_flight)
    outcomes = _passed(source, hired, count(len(source.ids)), ahead=crew.count)
    with contextlib.closing(outcomes):
        try:
            for outcome in outcomes:
                if outcome.index is not None and outcome.index >= len(source.ids):  # never taken
                    break
                yield outcome
        finally:
            source.stop()  # else workers would wait for the next pair
    if source.end is not None and not isinstance(source.end, CaptureEnded):
        raise source.end


def _passed(
    source: FrameSequence[AnyFrame], hired: Crew[NewResult], wanted: Iterable[int], *, ahead: int
) -> Generator[Done[NewResult] | Skipped]:
    """The frames `wanted`, in order, `ahead` of them in flight."""
    keep_freed_memory()
    todo = iter(wanted)
    with _opencv_single_threaded(), hired as workers:
        pending = deque(workers.submit(index) for index in islice(todo, ahead))
        while pending:
            task = pending.popleft()
            outcome = workers.outcome(task, source.ids[task.index])
            # Refilled before the consumer gets its turn: what it writes must not idle a worker.
            pending.extend(workers.submit(index) for index in islice(todo, 1))
            del task  # and its outcome with it
            yield outcome


@contextlib.contextmanager
def _opencv_single_threaded() -> Iterator[None]:
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
