"""A few threads that work off one queue and never hold up the end of the process."""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from types import TracebackType
from typing import ParamSpec, Self, TypeVar

# How long the end of a stream waits for frames in progress. An interrupted run must end within
# 5 s, whatever a frame does; `concurrent.futures` would wait for ever at interpreter exit.
SETTLE_S = 3.0

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Crew:
    """Worker threads as a context; leaving it drops what has not begun.

    A process that ends inside the context (an error keeps its traceback, and that the frames of
    all callers) leaves it first: a thread that meets the end of the interpreter inside C++ aborts
    the process.

    Args:
        workers: number of threads.
    """

    def __init__(self, workers: int) -> None:
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._closed = threading.Event()
        self._threads = [
            threading.Thread(target=self._work, name=f"frame-worker-{n}", daemon=True)
            for n in range(workers)
        ]

    def __enter__(self) -> Self:
        atexit.register(self._settle)
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        atexit.unregister(self._settle)
        self._settle()

    def _settle(self) -> None:
        self._closed.set()
        for _ in self._threads:
            self._tasks.put(None)
        deadline_s = time.monotonic() + SETTLE_S
        # A stream that nobody holds any more may be collected in one of its own threads.
        for thread in set(self._threads) - {threading.current_thread()}:
            thread.join(max(0.0, deadline_s - time.monotonic()))

    def submit(
        self,
        function: Callable[Arguments, Result],
        *args: Arguments.args,
        **options: Arguments.kwargs,
    ) -> Future[Result]:
        """Queue a call; the future gets what it returns or raises."""
        future: Future[Result] = Future()

        def call() -> None:
            try:
                future.set_result(function(*args, **options))
            except BaseException as error:  # handed to whoever waits for the future
                future.set_exception(error)

        self._tasks.put(call)
        return future

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            if not self._closed.is_set():
                task()
            del task  # else its result would live until the next one arrives
