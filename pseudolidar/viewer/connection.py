"""One connection of the network: what it may hold, and how long it may take nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast

from websockets.asyncio.server import ServerConnection
from websockets.frames import Opcode

from pseudolidar.viewer.inbound import MESSAGE_BYTES, PICTURE_BYTES
from pseudolidar.viewer.leftovers import Leftovers

# Connections at the same time, pages and what has not asked yet included.
MOST_CONNECTIONS = 128
# A connection that asks for nothing in this time is closed, s.
REQUEST_S = 10.0
# One that takes nothing of what is sent to it for so long is closed, s.
PATIENCE_S = 20.0
# Pieces of a message, of which browsers make one per 128 KiB; and pings, which they never send.
MOST_PIECES, MOST_PINGS = 1024, 64


class Connection(ServerConnection):
    """A connection that holds no more than its share of memory and time.

    websockets pings, and gives up where no answer comes in time; behind a large cloud on a slow
    line the answer comes late. Here the line is judged by whether anything is taken at all.

    Args:
        given: as websockets gives them; so are the settings.
        leftovers: of all connections of the server.
    """

    # Whether a picture was asked for that this one has not sent.
    is_due: Callable[[], bool] = staticmethod(bool)

    def __init__(self, *given: Any, leftovers: Leftovers, **settings: Any) -> None:
        super().__init__(*given, **settings)
        self._leftovers = leftovers

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Wait for a request, unless there are too many already."""
        super().connection_made(transport)
        self._pieces = self._pings = self._least = 0
        self._timer = self.loop.call_later(REQUEST_S, self.transport.abort)
        if len(self.server.handlers) > MOST_CONNECTIONS:
            self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing, and have freed what is left."""
        self._timer.cancel()
        super().connection_lost(exc)
        self._leftovers.come(self.loop)

    def data_received(self, data: bytes) -> None:
        """Take large messages only while a picture is due."""
        self.protocol.max_message_size = PICTURE_BYTES if self.is_due() else MESSAGE_BYTES
        super().data_received(data)

    def process_event(self, event: Any) -> None:
        """Count what costs memory though it carries nothing."""
        if self.request is None:
            self._timer.cancel()
            super().process_event(event)
            return
        if event.opcode is Opcode.PING:
            self._pings = self._pings + 1 if self.paused else 0  # answers wait to be taken
        elif event.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
            self._pieces = 0 if event.fin else self._pieces + 1
        if self._pings > MOST_PINGS or self._pieces > MOST_PIECES:
            self.transport.abort()
            return
        super().process_event(event)

    def pause_writing(self) -> None:
        """What was sent is not taken as fast: begin to watch."""
        super().pause_writing()
        self._least = self._left
        self._timer = self.loop.call_later(PATIENCE_S, self._look)

    def resume_writing(self) -> None:
        """It was taken."""
        super().resume_writing()
        self._timer.cancel()

    async def drain(self) -> None:
        """Wait until what was sent is taken; what comes after has its own time to be."""
        await super().drain()
        if self.close_deadline is not None and self.close_timeout is not None:
            self.close_deadline = self.loop.time() + self.close_timeout

    @property
    def _left(self) -> int:
        return cast("asyncio.WriteTransport", self.transport).get_write_buffer_size()

    def _look(self) -> None:
        if self._left >= self._least:
            self.transport.abort()
            return
        self._least = self._left
        self._timer = self.loop.call_later(PATIENCE_S, self._look)
