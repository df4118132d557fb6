"""Between the network and viser: judges requests and messages before viser sees them."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Awaitable, Callable, Iterator, Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl

from pseudolidar.errors import ServeError
from pseudolidar.viewer.answers import Page, closed_in, refusal, response
from pseudolidar.viewer.guard import Guard, Refused
from pseudolidar.viewer.inbound import PICTURE_BYTES, Control, fault_of

if TYPE_CHECKING:
    from viser import ViserServer
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

_log = logging.getLogger(__name__)

# Browsers at the same time, and wrong messages after which one is sent away.
MOST_CLIENTS, MOST_FAULTS = 16, 8
# Parts of a query of our own pages.
MOST_PARTS = 32
# Messages of a browser that may wait to be read.
MOST_WAITING = 64
# A browser that does not answer for so long is gone, s.
PATIENCE_S = 20.0


class Gate:
    """Stands between the network and viser while it is served."""

    def __init__(self, guard: Guard, pages: Mapping[str, Page]) -> None:
        self.guard = guard
        self._pages = pages
        self._viser: ViserServer | None = None
        self._reached = False
        self._clients = 0

    def opened(self, viser: ViserServer) -> None:
        """Let messages in: viser is whole.

        Raises:
            ServeError: viser was served past this gate.
        """
        if not self._reached:
            viser.stop()
            raise ServeError("viser did not pass its guard", fix="report this with your versions")
        viser.request_share_url = _no_tunnel  # type: ignore[method-assign]
        self._viser = viser

    @contextlib.contextmanager
    def in_place(self, listening: socket.socket) -> Iterator[None]:
        """Whatever is served meanwhile is served through this gate, at that socket."""
        from websockets.asyncio import server as library

        theirs = library.serve

        def ours(handler: Any, host: str, port: int, **settings: Any) -> Any:
            del host, port
            self._reached = True
            settings |= {
                "process_request": self._judge_by(settings["process_request"]),
                "max_size": PICTURE_BYTES,
                "max_queue": MOST_WAITING,
                "ping_interval": PATIENCE_S,
                "ping_timeout": PATIENCE_S,
                "server_header": None,
                "logger": _quiet(),
            }
            return theirs(self._handler(handler), sock=listening, **settings)

        library.serve = ours  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            library.serve = theirs  # type: ignore[misc]

    def _judge_by(self, theirs: Callable[..., Any]) -> Callable[..., Awaitable[Response | None]]:
        async def judge(connection: ServerConnection, request: Request) -> Response | None:
            upgrades = request.headers.get_all("Upgrade")
            if any("websocket" in upgrade.lower() for upgrade in upgrades):
                verdict = self.guard.websocket(request.headers)
                if isinstance(verdict, Refused):
                    return refusal(verdict)
                if self._clients >= MOST_CLIENTS:
                    full = Refused(f"{MOST_CLIENTS} look already", HTTPStatus.SERVICE_UNAVAILABLE)
                    return refusal(full)
                return None
            verdict = self.guard.page(request.path, request.headers)
            if isinstance(verdict, Refused):
                return refusal(verdict)
            response = await self._page(connection, request, theirs)
            if verdict.cookie:
                response.headers["Set-Cookie"] = verdict.cookie
            return response

        return judge

    async def _page(
        self, connection: ServerConnection, request: Request, theirs: Callable[..., Any]
    ) -> Response:
        path, _, text = request.path.partition("?")
        if path == "/":
            return closed_in(theirs(connection, request), framed="'none'")
        page = self._pages.get(path)
        if page is None:
            return refusal(Refused("no such page", HTTPStatus.NOT_FOUND))
        try:
            query = dict(parse_qsl(text, keep_blank_values=True, max_num_fields=MOST_PARTS))
        except ValueError:
            return refusal(Refused("a query of too many parts", HTTPStatus.BAD_REQUEST))
        answer = await asyncio.get_running_loop().run_in_executor(None, page, query)
        return closed_in(response(answer), framed="'self'")

    def _handler(self, theirs: Callable[..., Awaitable[None]]) -> Callable[..., Awaitable[None]]:
        async def handler(connection: ServerConnection) -> None:
            self._clients += 1
            try:
                connection.recv = _Listener(connection, self).recv  # type: ignore[assignment]
                await theirs(connection)
            except Exception as error:  # one browser's trouble is nobody else's
                _log.warning("a browser was sent away: %s", type(error).__name__)
            finally:
                self._clients -= 1

        return handler

    def control(self, uuid: str) -> Control | None:
        """The control of the page with that identity."""
        viser = self._viser
        handle = None if viser is None else viser.gui._gui_input_handle_from_uuid.get(uuid)
        if handle is None or handle.disabled or not handle.visible:
            return None
        props: Any = handle._impl.props
        options = getattr(props, "options", None)
        least, most = getattr(props, "min", None), getattr(props, "max", None)
        return Control(handle.value, least, most, None if options is None else tuple(options))

    def pictures_due(self, client: ServerConnection) -> int:
        """How many pictures were asked for that this browser has not sent."""
        from viser._messages import GetRenderResponseMessage

        viser = self._viser
        if viser is None:
            return 0
        server = viser._websock_server
        for number, connection in server._live_connections.items():
            handle = viser._connected_clients.get(number) if connection is client else None
            if handle is not None:
                handlers = handle._websock_connection._incoming_handlers
                return len(handlers.get(GetRenderResponseMessage, ()))
        return 0


class _Listener:
    """Reads a browser's messages; what may not pass is dropped, with one line in the log."""

    def __init__(self, connection: ServerConnection, gate: Gate) -> None:
        self._connection, self._gate = connection, gate
        self._receive = connection.recv
        self._faults = 0

    async def recv(self) -> bytes:
        """The next message that may pass."""
        import msgspec

        while True:
            raw, message = await self._receive(), None
            if isinstance(raw, bytes):
                with contextlib.suppress(msgspec.MsgspecError, ValueError, RecursionError):
                    message = msgspec.msgpack.decode(raw)
            due = self._gate.pictures_due(self._connection)
            fault = fault_of(message, len(raw), self._gate.control, pictures_due=due)
            if isinstance(raw, bytes) and not fault:
                return raw
            self._faults += 1
            _log.warning("a browser sent %s", fault)
            if self._faults > MOST_FAULTS:
                await self._connection.close(1008, "too many wrong messages")


def _no_tunnel(*_: Any, **__: Any) -> None:
    """Browsers may not make this public."""


def _quiet() -> logging.Logger:
    quiet = logging.getLogger(f"{__name__}.connections")
    quiet.setLevel(logging.CRITICAL)
    return quiet
