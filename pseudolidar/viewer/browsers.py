"""What is drawn for each browser by its own view, in one thread."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

from pseudolidar.viewer.late_thread import LateThread

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle, ViserServer

_log = logging.getLogger(__name__)
Looker = TypeVar("Looker")


class Browsers(Generic[Looker]):
    """Draws for each browser when its view moves, or when it is woken.

    Args:
        server: of the browsers.
        begin: what a browser has when it comes.
        draw: draws for one; tells whether there is more to do.
        name: of the thread, and of what is drawn.
        pause_s: rest after each round.

    `lookers` has what each browser has, by its number.
    """

    def __init__(
        self,
        server: ViserServer,
        begin: Callable[[ClientHandle], Looker],
        draw: Callable[[Looker], bool],
        *,
        name: str,
        pause_s: float,
    ) -> None:
        self._begin, self._draw, self._name, self._pause_s = begin, draw, name, pause_s
        self.lookers: dict[int, Looker] = {}
        self._awake, self._ended = threading.Event(), threading.Event()
        self._thread = LateThread(self._run, name)
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._gone)

    def wake(self) -> None:
        """Look again what is to be drawn: something has changed."""
        self._awake.set()

    def close(self) -> None:
        """Draw nothing more."""
        self._ended.set()
        self._awake.set()
        self._thread.close()

    def _connected(self, client: ClientHandle) -> None:
        self.lookers[client.client_id] = self._begin(client)

        # In the loop of viser itself, since it only leaves word.
        async def moved(_: CameraHandle) -> None:
            self._awake.set()

        client.camera.on_update(moved)
        self._thread.begin()
        self._awake.set()

    def _gone(self, client: ClientHandle) -> None:
        self.lookers.pop(client.client_id, None)

    def _run(self) -> None:
        while not self._ended.is_set():
            self._awake.wait()
            self._awake.clear()
            more = False
            for looker in list(self.lookers.values()):
                try:
                    more |= self._draw(looker)
                except Exception:  # one that is gone, or odd, must not keep others from drawing
                    _log.exception("%s: cannot be drawn for a browser", self._name)
            self._ended.wait(self._pause_s)
            if more:
                self._awake.set()
