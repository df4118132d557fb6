"""A few workers that do frames off one queue, and never hold up the end of the process.

Each worker has a thread of this process. What it does with a frame is its own affair: do it there
(`InThread`), or have it done by a process (`isolated.Isolated`).
"""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from queue import SimpleQueue
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

from pseudolidar.errors import FrameTimeout
from pseudolidar.running.crew.attempt import AnyFrame, Done, NewResult, Skipped, attempt
from pseudolidar.running.crew.given_up import WORKER_NAME
from pseudolidar.running.crew.in_flight import InFlight
from pseudolidar.sources.source import FrameSequence

# How long the end of a stream waits for frames in progress. An interrupted run must end within
# 5 s, whatever a frame does; `concurrent.futures` would wait for ever at interpreter exit.
SETTLE_S = 3.0
# How often a frame that is waited for is looked at, at least.
WATCH_S = 60.0

Result = TypeVar("Result", covariant=True)


class Worker(Protocol[Result]):
    """Does frames, one at a time, in the thread that calls it."""

    def prepare(self) -> None:
        """Get ready for the next frame: called before there is one, so that its time counts."""

    def do(self, index: int) -> Done[Result] | Skipped:
        """Do a frame; every failure is an outcome."""

    def drop(self) -> None:
        """Give up what is being done, where that is possible; called from any thread."""

    def end(self) -> None:
        """Let go of everything; called from the worker's thread, last."""


class InThread(Generic[AnyFrame, NewResult]):
    """Does frames in the thread itself; a frame that hangs cannot be ended, only left alone.

    Args:
        source: what to read.
        per_frame: what to do with a frame.
        in_flight: where frames are noted while they are done, or None.
    """

    def __init__(
        self,
        source: FrameSequence[AnyFrame],
        per_frame: Callable[[AnyFrame], NewResult],
        in_flight: InFlight | None,
    ) -> None:
        self._source, self._per_frame, self._in_flight = source, per_frame, in_flight

    def prepare(self) -> None:
        """Nothing to do."""

    def do(self, index: int) -> Done[NewResult] | Skipped:
        """Do a frame here."""
        if self._in_flight is None:
            return attempt(self._source, self._per_frame, index)
        with self._in_flight.noted(self._source.ids[index]):
            return attempt(self._source, self._per_frame, index)

    def drop(self) -> None:
        """Nothing that could be done: a thread cannot be ended."""

    def end(self) -> None:
        """Nothing to let go of."""


@dataclass(eq=False)
class Task(Generic[NewResult]):
    """A frame that is wanted.

    Args:
        index: its position in the source.
        outcome: what became of it.
        begun_s: when it was begun, on the monotonic clock; None before.
        member: who does it.
    """

    index: int
    outcome: Future[Done[NewResult] | Skipped] = field(default_factory=Future)
    begun_s: float | None = None
    member: _Member[NewResult] | None = None


@dataclass(eq=False)
class _Member(Generic[NewResult]):
    """A thread of the crew with its worker."""

    worker: Worker[NewResult]
    thread: threading.Thread | None = None
    dismissed: bool = False


class Crew(Generic[NewResult]):
    """Worker threads as a context; leaving it drops what has not begun.

    A process that ends inside the context (an error keeps its traceback, and that the frames of
    all callers) leaves it first: a thread that meets the end of the interpreter inside C++ aborts
    the process.

    Args:
        hire: makes a worker; called once for each thread.
        workers: number of threads.
        timeout_s: a frame that takes longer is given up and its worker replaced.
    """

    def __init__(
        self, hire: Callable[[], Worker[NewResult]], workers: int, *, timeout_s: float
    ) -> None:
        self._hire, self._workers, self._timeout_s = hire, workers, timeout_s
        self._tasks: SimpleQueue[Task[NewResult] | None] = SimpleQueue()
        self._closed = threading.Event()
        self._settling = threading.Lock()  # between an outcome that comes and one given up
        self._members: list[_Member[NewResult]] = []

    def __enter__(self) -> Self:
        atexit.register(self._settle)
        for _ in range(self._workers):
            self._add_member()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        atexit.unregister(self._settle)
        self._settle()

    def submit(self, index: int) -> Task[NewResult]:
        """Queue a frame."""
        task: Task[NewResult] = Task(index)
        self._tasks.put(task)
        return task

    def outcome(self, task: Task[NewResult], name: str) -> Done[NewResult] | Skipped:
        """Wait until a frame is done, or has taken too long.

        Frames are begun in the order they were queued in, so it is enough to watch the one that is
        waited for.
        """
        while True:
            try:
                return task.outcome.result(min(self._left_s(task), WATCH_S))
            except TimeoutError:
                if self._left_s(task) <= 0 and self._given_up(task):
                    return Skipped(name, task.index, _late(name, self._timeout_s))

    def _left_s(self, task: Task[NewResult]) -> float:
        """Time that a task still has; all of it before it was begun."""
        taken_s = 0.0 if task.begun_s is None else time.monotonic() - task.begun_s
        return max(0.0, self._timeout_s - taken_s)

    def _given_up(self, task: Task[NewResult]) -> bool:
        """Replace the worker of a task, unless it has just come."""
        assert task.member is not None
        with self._settling:
            if task.outcome.done():
                return False
            task.member.dismissed = True
        task.member.worker.drop()
        self._members.remove(task.member)
        self._add_member()
        return True

    def _add_member(self) -> None:
        member = _Member(self._hire())
        number = len(self._members)
        member.thread = threading.Thread(
            target=self._work, args=(member,), name=f"{WORKER_NAME}-{number}", daemon=True
        )
        self._members.append(member)
        member.thread.start()

    def _settle(self) -> None:
        self._closed.set()
        for member in self._members:
            self._tasks.put(None)
            member.worker.drop()
        deadline_s = time.monotonic() + SETTLE_S
        # A stream that nobody holds any more may be collected in one of its own threads.
        threads = {member.thread for member in self._members} - {threading.current_thread(), None}
        for thread in threads:
            if thread is not None:
                thread.join(max(0.0, deadline_s - time.monotonic()))

    def _work(self, member: _Member[NewResult]) -> None:
        try:
            while True:
                member.worker.prepare()
                task = self._tasks.get()
                if task is None or self._closed.is_set() or not self._do(task, member):
                    return
                del task  # else its result would live until the next one arrives
        finally:
            member.worker.end()

    def _do(self, task: Task[NewResult], member: _Member[NewResult]) -> bool:
        """Do a task; whether the worker is still wanted then."""
        task.member, task.begun_s = member, time.monotonic()
        try:
            outcome = member.worker.do(task.index)
        except BaseException as error:  # handed to whoever waits for the outcome
            with self._settling:
                if not member.dismissed:
                    task.outcome.set_exception(error)
                return not member.dismissed
        with self._settling:
            if not member.dismissed:
                task.outcome.set_result(outcome)
        return not member.dismissed


def _late(name: str, timeout_s: float) -> FrameTimeout:
    return FrameTimeout(
        f"no result within {timeout_s:g} s",
        want="a frame that ends",
        fix="Allow more by --timeout, or leave the frame out by --exclude.",
        where=f"frame {name}",
    )
