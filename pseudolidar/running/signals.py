"""Ctrl-C and SIGTERM: the frame in hand is finished, then the run ends in order."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Self

STOPPING = (signal.SIGINT, signal.SIGTERM)
# What a shell reports for a process that a signal ended.
SIGNAL_EXIT_BASE = 128


class Stopped(KeyboardInterrupt):
    """The run was asked to stop; a `KeyboardInterrupt`, so that no `except Exception` eats it.

    Whoever knows better than the command line what the user can do next sets `advice`; "" leaves it
    to the command line.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.advice = ""
        self.exit_code = SIGNAL_EXIT_BASE + number


class StopSignals:
    """Context in which SIGINT and SIGTERM raise `Stopped`, but never inside `held()`.

    Outside the main thread Python cannot catch signals; the context then does nothing.

    Args:
        first: called by a first signal instead, for work that ends by itself when it is told to.
            It must not wait for anything.
    """

    def __init__(self, first: Callable[[], None] | None = None) -> None:
        self._first = first
        self.told: int | None = None  # the signal that `first` was called for
        self._held = False
        self._pending: int | None = None
        self._previous: dict[signal.Signals, object] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in STOPPING:
                self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, previous in self._previous.items():
            signal.signal(number, previous)  # type: ignore[arg-type]
        self._previous.clear()

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """A block that a first signal does not cut; it is raised when the block ends.

        A second signal is: whoever asks twice does not want to wait.
        """
        self._held = True
        try:
            yield
        finally:
            self._held = False
        if self._pending is not None:
            raise Stopped(self._pending)

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        if self._first is not None and self.told is None:
            self.told = number
            self._first()
        elif self._held and self._pending is None:
            self._pending = number
        else:
            raise Stopped(number)
