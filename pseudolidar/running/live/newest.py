"""What is done with the newest frame now and then, in a thread that no frame waits for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Generic, Self, TypeVar

Shown = TypeVar("Shown")


class Newest(Generic[Shown]):
    """Hands over the newest of what it is shown, now and then, until the block ends.

    `given` counts what it was shown, `passed_over` what of that was never handed over.

    Args:
        name: of the thread.
        do: takes it; the seconds until the next one is wanted, None if no more are.
        idle_s: how often it is looked whether there is something new.
    """

    def __init__(self, name: str, do: Callable[[Shown], float | None], *, idle_s: float) -> None:
        self._do, self._idle_s = do, idle_s
        self._newest: tuple[int, Shown] | None = None
        self._done = -1
        self.given = self.passed_over = 0
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def show(self, number: int, what: Shown) -> None:
        """Have this done, unless something newer was shown already; from any thread.

        Args:
            number: larger for what is newer.
            what: to do.
        """
        with self._lock:
            newer = number > (self._done if self._newest is None else self._newest[0])
            # Of two that nobody has taken yet, one is never done.
            self.passed_over += self._newest is not None or not newer
            self.given += 1
            if newer:
                self._newest = number, what

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        pause_s: float | None = 0.0
        while pause_s is not None and not self._stop.wait(pause_s):
            pause_s = self._once()
        if pause_s is not None:
            self._once()  # the last one counts

    def _once(self) -> float | None:
        with self._lock:
            newest, self._newest = self._newest, None
            if newest is None:
                return self._idle_s
            self._done = newest[0]
        return self._do(newest[1])
