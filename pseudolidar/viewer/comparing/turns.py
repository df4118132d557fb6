"""Whose turn it is, moved on at a steady pace."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from pseudolidar.viewer.late_thread import LateThread

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
        self._thread = LateThread(self._turn, "viewer-turns")

    def run(self, *, wanted: bool) -> None:
        """Go on, or rest."""
        if not wanted:
            self._wanted.clear()
            return
        self._wanted.set()
        self._thread.begin()

    def close(self) -> None:
        """End for good."""
        self._ended.set()
        self._wanted.set()
        self._thread.close()

    def _turn(self) -> None:
        while self._wanted.wait() and not self._ended.wait(self._pace_s):
            if not self._wanted.is_set():
                continue
            try:
                self._next()
            except Exception:  # one turn's trouble is not that of the next
                _log.exception("a turn was not taken")
