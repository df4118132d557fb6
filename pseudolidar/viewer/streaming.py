"""Answers that are too long for the memory, sent piece by piece as they are taken."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from typing import cast

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Response

_log = logging.getLogger(__name__)

# So many at the same time; each has a piece in memory, and its own thread to make the next.
AT_ONCE = 4


class Sent(Response):
    """A response that is on its way already: nothing of it is left to be written."""

    def serialize(self) -> bytes:
        """Nothing."""
        return b""


class Streaming:
    """Sends long answers; who takes nothing is closed by its connection, as any other."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="viewer-streams")
        self._running = 0

    @property
    def is_full(self) -> bool:
        """Whether so many are sent already that another one has to come later."""
        return self._running >= AT_ONCE

    async def send(
        self, connection: ServerConnection, head: Response, pieces: Generator[bytes]
    ) -> Response:
        """Write head and body, and tell websockets that this is done.

        A body that breaks ends the connection early: with the length in its head, a browser sees
        that the file is not whole.

        Args:
            connection: that asked.
            head: with all headers, and no body.
            pieces: of the body.
        """
        self._running += 1
        try:
            transport = cast("asyncio.WriteTransport", connection.transport)
            transport.write(head.serialize())
            loop = asyncio.get_running_loop()
            while piece := await loop.run_in_executor(self._threads, next, pieces, b""):
                if transport.is_closing():
                    break
                transport.write(piece)
                await connection.drain()
        except Exception as error:  # its trouble is nobody else's; what was promised is not kept
            _log.warning("a file could not be sent whole: %s", type(error).__name__)
            connection.transport.abort()
        finally:
            self._running -= 1
            with contextlib.suppress(ValueError):  # at the end of all, a thread may be within it
                pieces.close()
        return Sent(head.status_code, head.reason_phrase, head.headers)
