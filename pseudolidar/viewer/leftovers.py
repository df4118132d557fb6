"""What connections leave behind, and when it is freed."""

from __future__ import annotations

import asyncio
import gc

# How long after a connection has ended, s. A search takes 0.1 s, in which nobody is answered.
WAIT_S = 20.0


class Leftovers:
    """Frees what connections that have ended refer to in circles.

    The errors that end one hold its tasks, these its messages, and these the arrays of clouds that
    were to be sent. Python looks for such circles by how many objects there are, and these are few:
    those of half an hour held 150 MB (docs/viewer.md).
    """

    def __init__(self) -> None:
        self._awaited = False

    def come(self, loop: asyncio.AbstractEventLoop) -> None:
        """A connection has ended.

        Args:
            loop: that it ran in.
        """
        if not self._awaited:
            self._awaited = True
            loop.call_later(WAIT_S, self._free)

    def _free(self) -> None:
        self._awaited = False
        gc.collect()
