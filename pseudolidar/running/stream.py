"""Ordered, bounded, parallel passage of a source's frames through per-frame work.

Threads, because decoding, matching and encoding happen in native code that releases the GIL. One
frame uses one thread: with a frame for every core nothing is gained by splitting one, and OpenCV's
own pool would only fight for the cores. While a stream runs, OpenCV is therefore set to one thread.
"""

from __future__ import annotations

import contextlib
import os
import time
import traceback
from collections import deque
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar

from pseudolidar.errors import FrameError, PseudolidarError, UsageError
from pseudolidar.running.crew import Crew
from pseudolidar.running.memory import keep_freed_memory
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

# Frames in flight per worker: one that is worked on and one that is finished or waits, so that
# neither a slow neighbour nor a slow disk makes a worker stop. Memory is this times a frame.
IN_FLIGHT_PER_WORKER = 2

Result = TypeVar("Result", covariant=True)
NewResult = TypeVar("NewResult")
AnyFrame = TypeVar("AnyFrame", bound=Frame)


@dataclass(frozen=True)
class Done(Generic[Result]):
    """A frame that passed.

    Args:
        id: the source's name of the frame.
        index: its position in the source.
        value: what the per-frame work returned.
        cpu_s: processor seconds of its worker, decoding included.
    """

    id: str
    index: int
    value: Result
    cpu_s: float = 0.0


@dataclass(frozen=True)
class Skipped:
    """A frame that did not pass.

    Args:
        id: the source's name of the frame.
        index: its position in the source, None for one that never had a pair.
        error: why.
        trace: traceback of an unexpected failure, for developers; "" otherwise.
    """

    id: str
    index: int | None
    error: PseudolidarError
    trace: str = ""


def stream(
    source: FrameSequence[AnyFrame],
    per_frame: Callable[[AnyFrame], NewResult],
    *,
    workers: int | None = None,
    skip: Collection[str] = (),
) -> Iterator[Done[NewResult] | Skipped]:
    """Pass each frame of `source` through `per_frame`, in parallel, and yield results in order.

    A frame that fails is yielded as `Skipped` and ends nothing. The number of frames in flight is
    bounded, so memory does not grow with the sequence. Results do not depend on `workers`.

    Args:
        source: what to read; `source.load(index)` is called in the workers.
        per_frame: pure function of a frame.
        workers: threads; None for one per core.
        skip: ids that are left out (committed before).

    Raises:
        UsageError: less than one worker.

    Yields:
        First what the source refused when it was opened, then every other frame by index.
    """
    if workers is not None and workers < 1:
        raise UsageError(f"{workers} workers", want="at least 1", where="--workers")
    yield from (Skipped(name, None, error) for name, error in source.refused)
    workers = workers or default_workers()
    keep_freed_memory()
    todo = (index for index, name in enumerate(source.ids) if name not in skip)
    with _opencv_single_threaded(), Crew(workers) as crew:
        pending = deque(
            crew.submit(attempt, source, per_frame, index)
            for index in islice(todo, IN_FLIGHT_PER_WORKER * workers)
        )
        while pending:
            outcome = pending.popleft().result()
            # Refilled before the consumer gets its turn: what it writes must not idle a worker.
            pending.extend(crew.submit(attempt, source, per_frame, i) for i in islice(todo, 1))
            yield outcome


def default_workers() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def attempt(
    source: FrameSequence[AnyFrame], per_frame: Callable[[AnyFrame], NewResult], index: int
) -> Done[NewResult] | Skipped:
    """Load and do one frame; whatever goes wrong is an outcome, not an exception."""
    name, begin_s = source.ids[index], time.thread_time()
    try:
        value = per_frame(source.load(index))
        return Done(name, index, value, time.thread_time() - begin_s)
    except PseudolidarError as error:
        return Skipped(name, index, _detached(error))
    except Exception as error:  # whatever one frame does, the run goes on and tells of it
        unexpected = FrameError(
            f"{type(error).__name__}: {error}",
            want="a frame that can be processed",
            fix="Run with --debug and report this.",
            where=f"frame {name}",
        )
        return Skipped(name, index, unexpected, traceback.format_exc())


def _detached(error: PseudolidarError) -> PseudolidarError:
    """The error without its traceback, which would keep a frame's arrays alive."""
    error.__cause__ = error.__context__ = None
    return error.with_traceback(None)


@contextlib.contextmanager
def _opencv_single_threaded() -> Iterator[None]:
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
