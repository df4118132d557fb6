"""Listens to one browser: what may not pass is dropped, and nobody is heard too often."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pseudolidar.viewer.inbound import MESSAGE_BYTES, Fault, Touchable, fault_of
from pseudolidar.viewer.pace import Pace

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

_log = logging.getLogger(__name__)

# Wrong messages after which a browser is sent away; how long it may take to go, s, and how many
# messages it may have sent before it hears of it.
MOST_FAULTS, GOODBYE_S, MOST_LEFT = 8, 1.0, 64
# What asks for a search through all points; how often that, and all that a browser says, may come:
# a second in the long run, and at once.
CLICK = "ScenePointerMessage"
CLICK_PACE, PACE = (10.0, 20), (120.0, 240)


class Listener:
    """Reads a browser's messages; each that is dropped is one line in the log.

    Args:
        connection: of the browser.
        touchable: what can be touched.
        due: how many pictures it was asked for and has not sent.
    """

    def __init__(
        self,
        connection: ServerConnection,
        touchable: Touchable,
        due: Callable[[], int],
    ) -> None:
        self._connection, self._touchable, self.due = connection, touchable, due
        self._receive = connection.recv
        self._faults = 0
        self._clicks, self._all = Pace(*CLICK_PACE), Pace(*PACE)

    async def recv(self) -> bytes:
        """The next message that may pass, when it is time for it."""
        while True:
            raw = await self._receive()
            message: Any = _decoded(raw) if isinstance(raw, bytes) else None
            fault = fault_of(message, len(raw), self._touchable, pictures_due=self.due())
            if fault is None or fault.late:
                await self._wait()
            if fault is not None:
                await self._drop(fault)
                continue
            if message["type"] == CLICK and not self._clicks.allows(time.monotonic()):
                continue  # nobody clicks as often, and late ones mean nothing any more
            assert isinstance(raw, bytes)  # text is no message
            return raw

    async def _drop(self, fault: Fault) -> None:
        level = logging.DEBUG if fault.late else logging.WARNING
        _log.log(level, "a browser sent %s", fault.words)
        self._faults += not fault.late
        if self._faults > MOST_FAULTS:
            await self._send_away()

    async def _send_away(self) -> None:
        """Close the connection, and end who listens to it.

        Its answer to that comes behind what it has said before: that is read and thrown away, or
        nothing more would be read where much of it waits. Who says more in place of an answer is
        cut off.

        Raises:
            ConnectionClosed: always.
        """
        from websockets.exceptions import ConnectionClosedError

        closing = asyncio.ensure_future(self._connection.close(1008, "too many wrong messages"))
        await asyncio.sleep(0)  # it is told before more is read
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(GOODBYE_S):
                for _ in range(MOST_LEFT):
                    await self._receive()
        self._connection.transport.abort()
        await closing
        raise ConnectionClosedError(None, None)

    async def _wait(self) -> None:
        """Until it is time; nothing is read meanwhile, so that who floods this holds up itself."""
        if (wait_s := self._all.wait_s(time.monotonic())) > 0:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._connection.wait_closed(), wait_s)


def _decoded(raw: bytes) -> Any:
    """What a message says; None where it is none. Of long ones only a picture is read at all.

    A few megabytes of MessagePack can hold gigabytes of empty lists.
    """
    import msgspec

    with contextlib.suppress(msgspec.MsgspecError, ValueError, RecursionError):
        if len(raw) <= MESSAGE_BYTES:
            return msgspec.msgpack.decode(raw)
        fields = [("type", str), ("payload", bytes), ("render_uuid", str)]
        kind = msgspec.defstruct("Picture", fields, forbid_unknown_fields=True)
        return msgspec.structs.asdict(msgspec.msgpack.decode(raw, type=kind))
    return None
