"""Whose turn it is, moved on at a steady pace."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

_log = logging.getLogger(__name__)

# How long each is shown, s.
PACE_S = 0.8


class Turns:
    """Calls something again and again, while it is wanted.

    Args:
        next_turn: called from a thread of its own.
        pace_s: between calls.
    """

    def __init__(self, next_turn: Callable[[], None], pace_s: float = PACE_S) -> None:
        self._next, self._pace_s = next_turn, pace_s
        self._wanted, self._ended = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def run(self, *, wanted: bool) -> None:
        """Go on, or rest."""
        if not wanted:
            self._wanted.clear()
            return
        self._wanted.set()
        if self._thread is None:
            self._thread = threading.Thread(target=self._turn, name="viewer-turns", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End for good."""
        self._ended.set()
        self._wanted.set()
        if self._thread is not None:
            self._thread.join()

    def _turn(self) -> None:
        while self._wanted.wait() and not self._ended.wait(self._pace_s):
            if not self._wanted.is_set():
                continue
            try:
                self._next()
            except Exception:  # one turn's trouble is not that of the next
                _log.exception("a turn was not taken")
