"""A thread that begins when it is first needed."""

from __future__ import annotations

import threading
from collections.abc import Callable


class LateThread:
    """Begins once at most, and not any more after its end; may be asked from any thread.

    Args:
        run: what it does; has to return soon after it was told that this is the end.
        name: of the thread.
    """

    def __init__(self, run: Callable[[], None], name: str) -> None:
        self._run, self._name = run, name
        self._changing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._closed = False

    def begin(self) -> None:
        """Begin, unless it has begun or ended."""
        with self._changing:
            if self._thread is None and not self._closed:
                thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                thread.start()
                self._thread = thread

    def close(self) -> None:
        """Wait until it has ended, if it ever began."""
        with self._changing:
            self._closed, thread = True, self._thread
        if thread is not None:
            thread.join()
