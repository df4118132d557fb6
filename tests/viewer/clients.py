"""What asks a server for pages and websockets, as browsers do and as they do not."""

from __future__ import annotations

import http.client
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import viser
from websockets.sync.client import ClientConnection, connect

from pseudolidar.viewer.server import GuardedServer

# Where somebody looks from, as a browser says it.
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 1.0],
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [1.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


def port_of(server: GuardedServer) -> int:
    return server.guard.port


def get(server: GuardedServer, target: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=10)
    connection.request("GET", target, headers=headers)
    return connection.getresponse()


def cookie(server: GuardedServer) -> dict[str, str]:
    return {"Cookie": f"{server.guard.cookie_name}={server.guard.session}"}


def look(server: GuardedServer, **headers: str) -> ClientConnection:
    """A websocket as viser's page opens it."""
    port = port_of(server)
    given = cookie(server) | {"Origin": f"http://127.0.0.1:{port}"} | headers
    return connect(
        f"ws://127.0.0.1:{port}",
        additional_headers={name: value for name, value in given.items() if value},
        subprotocols=[f"viser-v{viser.__version__}"],
        compression=None,
        max_size=None,
        max_queue=1,  # what is not taken is not read from the network either
    )


@contextmanager
def looking(server: GuardedServer) -> Iterator[ClientConnection]:
    """The same, ended by its network and not by words: what it has not read does not matter."""
    client = look(server)
    try:
        yield client
    finally:
        with suppress(OSError):
            client.socket.shutdown(socket.SHUT_RDWR)
        client.socket.close()


def wait_until(true: Callable[[], bool], *, patience_s: float = 60.0) -> None:
    end = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < end, "not in time"
        time.sleep(0.02)
