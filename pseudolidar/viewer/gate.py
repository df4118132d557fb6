"""Between the network and viser: judges requests and messages before viser sees them."""

from __future__ import annotations

import contextlib
import logging
import socket
from collections.abc import Awaitable, Callable, Iterator, Mapping
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from pseudolidar.errors import ServeError
from pseudolidar.viewer.answering import Answering
from pseudolidar.viewer.answers import (
    Page,
    closed_in,
    refusal,
    response,
    status_alone,
    with_cookie,
)
from pseudolidar.viewer.guard import Admitted, Guard, Refused
from pseudolidar.viewer.inbound import MESSAGE_BYTES
from pseudolidar.viewer.leftovers import Leftovers
from pseudolidar.viewer.listener import Listener
from pseudolidar.viewer.on_page import OnPage

if TYPE_CHECKING:
    from viser import ViserServer
    from websockets.http11 import Request, Response

    from pseudolidar.viewer.connection import Connection

_log = logging.getLogger(__name__)

# Browsers at the same time.
MOST_CLIENTS = 16
# Messages of a browser that may wait to be read.
MOST_WAITING = 16
# How often a browser is pinged, and after how long without an answer it is gone, s. What waits for
# a large cloud on a slow line answers late; `connection.py` tells who takes nothing at all.
PING_S, GONE_S = 20.0, 300.0
# To say good-bye, s.
CLOSE_S = 10.0


class Gate:
    """Stands between the network and viser while it is served.

    Args:
        guard: judges who comes.
        pages: our own pages by path, added to at any time.
        spoken: the protocol that viser's page of this version asks for.
    """

    def __init__(self, guard: Guard, pages: Mapping[str, Page], spoken: str) -> None:
        from pseudolidar.viewer.streaming import Streaming

        self.guard = guard
        self._spoken = spoken
        self._answering = Answering(pages)
        self._streaming = Streaming()
        self.on_page = OnPage()
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
        self.on_page.viser = viser

    @contextlib.contextmanager
    def in_place(self, listening: socket.socket) -> Iterator[None]:
        """Whatever is served meanwhile is served through this gate, at that socket."""
        from websockets.asyncio import server as library

        from pseudolidar.viewer.connection import Connection

        theirs = library.serve

        def ours(handler: Any, host: str, port: int, **settings: Any) -> Any:
            del host, port
            self._reached = True
            settings |= {
                "process_request": self._judge_by(settings["process_request"]),
                "create_connection": partial(Connection, leftovers=Leftovers()),
                "open_timeout": None,
                "close_timeout": CLOSE_S,
                "max_size": MESSAGE_BYTES,
                "max_queue": MOST_WAITING,
                "ping_interval": PING_S,
                "ping_timeout": GONE_S,
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
        async def judge(connection: Connection, request: Request) -> Response | None:
            upgrades = request.headers.get_all("Upgrade")
            if any("websocket" in upgrade.lower() for upgrade in upgrades):
                refused = self._refused(request)
                return None if refused is None else refusal(refused)
            verdict = self.guard.page(request.path, request.headers)
            if isinstance(verdict, Refused):
                return refusal(verdict)
            if request.path.partition("?")[0] == "/":
                page = closed_in(theirs(connection, request), framed="'none'")
                return with_cookie(page, verdict)
            return await self._answer(connection, request, verdict)

        return judge

    def _refused(self, request: Request) -> Refused | None:
        """Why a websocket is not opened; None where it is."""
        verdict = self.guard.websocket(request.headers)
        if isinstance(verdict, Refused):
            return verdict
        if request.headers.get_all("Sec-WebSocket-Protocol") != [self._spoken]:
            return Refused("a page of another version", HTTPStatus.BAD_REQUEST)
        if self._clients >= MOST_CLIENTS:
            return Refused(f"{MOST_CLIENTS} look already", HTTPStatus.SERVICE_UNAVAILABLE)
        return None

    async def _answer(
        self, connection: Connection, request: Request, verdict: Admitted
    ) -> Response:
        """A page of our own."""
        answer = await self._answering.answer(request.path)
        if answer.pieces is not None and self._streaming.is_full:
            answer = status_alone(HTTPStatus.SERVICE_UNAVAILABLE)
        framed = "'self'" if answer.status is HTTPStatus.OK else "'none'"
        head = with_cookie(closed_in(response(answer), framed=framed), verdict)
        if answer.pieces is None:
            return head
        return await self._streaming.send(connection, head, answer.pieces)

    def _handler(self, theirs: Callable[..., Awaitable[None]]) -> Callable[..., Awaitable[None]]:
        async def handler(connection: Connection) -> None:
            if self._clients >= MOST_CLIENTS:  # several were judged before one was counted
                await connection.close(1013, "too many look already")
                return
            self._clients += 1
            try:
                on_page = self.on_page
                listener = Listener(connection, on_page, lambda: on_page.pictures_due(connection))
                connection.is_due = lambda: listener.due() > 0
                connection.recv = listener.recv  # type: ignore[assignment]
                await theirs(connection)
            except Exception as error:  # one browser's trouble is nobody else's
                _log.warning("a browser was sent away: %s", type(error).__name__)
            finally:
                self._clients -= 1

        return handler


def _no_tunnel(*_: Any, **__: Any) -> None:
    """Browsers may not make this public."""


def _quiet() -> logging.Logger:
    quiet = logging.getLogger(f"{__name__}.connections")
    quiet.setLevel(logging.CRITICAL)
    return quiet
