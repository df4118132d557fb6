"""Work in a thread of its own of which only the latest is wanted."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

_log = logging.getLogger(__name__)
Request = TypeVar("Request")
# Where it makes way for others: how long it rests after work, as a multiple of what that took, and
# the longest rest, s.
RESTS, LONGEST_REST_S = 4.0, 2.0


class Latest(Generic[Request]):
    """Does what was asked for last; what was asked for before it, and not begun, is dropped.

    Args:
        work: does a request; may ask between its steps whether it is overtaken, and end then.
        name: of the thread.
        makes_way: whether others need the processor now, and each work is followed by a rest.
    """

    def __init__(
        self,
        work: Callable[[Request, Callable[[], bool]], None],
        *,
        name: str = "latest",
        makes_way: Callable[[], bool] = bool,
    ) -> None:
        self._work, self._name, self._makes_way = work, name, makes_way
        self._changed = threading.Condition()
        self._next: list[Request] = []
        self._busy = self._closed = False
        self._thread: threading.Thread | None = None

    def ask(self, request: Request) -> None:
        """Do this next, and nothing else that waits."""
        with self._changed:
            if self._closed:
                return
            self._next = [request]
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def idle(self, timeout_s: float) -> bool:
        """Wait until all is done; tells whether it is."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._next and not self._busy, timeout_s)

    def close(self) -> None:
        """Begin nothing more, and wait for what was begun."""
        with self._changed:
            self._closed, self._next = True, []
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _overtaken(self) -> bool:
        with self._changed:
            return bool(self._next) or self._closed

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._next or self._closed)
                if self._closed:
                    return
                (request,), self._next, self._busy = self._next, [], True
            begun_s = time.monotonic()
            try:
                self._work(request, self._overtaken)
            except Exception:  # one request's trouble is not that of the next
                _log.exception("%s: not done", self._name)
            self._rest(time.monotonic() - begun_s)

    def _rest(self, worked_s: float) -> None:
        """Nothing for a while; who asks when nobody else needs the processor ends it."""
        if not self._makes_way():
            return
        with self._changed:
            self._changed.wait_for(
                lambda: self._closed or (self._next and not self._makes_way()),
                min(RESTS * worked_s, LONGEST_REST_S),
            )
