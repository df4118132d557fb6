"""What a connection may cost: time, memory, and other people's patience."""

from __future__ import annotations

import asyncio
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import msgspec
import numpy as np
import psutil
import pytest
from viser import PointCloudHandle
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from pseudolidar.viewer import connection, gate, listener
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.server import GuardedServer, serve
from tests.viewer.clients import CAMERA, cookie, get, look, looking, port_of, wait_until

POINTS = 200_000
MOST = 24


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> Iterator[GuardedServer]:
    """A server that gives up soon."""
    monkeypatch.setattr(connection, "REQUEST_S", 0.3)
    monkeypatch.setattr(connection, "PATIENCE_S", 0.3)
    monkeypatch.setattr(connection, "MOST_CONNECTIONS", MOST)
    monkeypatch.setattr(gate, "CLOSE_S", 0.2)
    started = serve(Address(port=0), label="impatient")
    yield started
    started.stop()


def raw(server: GuardedServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port_of(server)), timeout=5)


def is_closed(client: socket.socket) -> bool:
    """Whether the other side ends it, sooner or later."""
    with suppress(ConnectionError):
        return client.recv(1) == b""
    return True


def cloud_of(server: GuardedServer) -> PointCloudHandle:
    zeros = np.zeros((POINTS, 3), np.float32)
    return server.viser.scene.add_point_cloud("/cloud", zeros, zeros.astype(np.uint8))


def drawn(handle: PointCloudHandle, turns: int) -> Iterator[int]:
    for turn in range(turns):
        handle.points = np.full((POINTS, 3), turn, np.float32)
        yield turn


def test_who_asks_for_nothing_is_closed(impatient: GuardedServer):
    silent, slow = raw(impatient), raw(impatient)
    slow.sendall(b"GET / HTTP/1.1\r\nHost:")
    assert is_closed(silent)
    assert is_closed(slow)


def test_more_connections_than_may_be_are_closed_at_once(
    impatient: GuardedServer, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(connection, "REQUEST_S", 60.0)
    with looking(impatient) as quick:
        many = [raw(impatient) for _ in range(60)]
        wait_until(lambda: len(select.select(many, [], [], 0)[0]) >= 60 - MOST)
        impatient.viser.scene.add_frame("/still")
        assert quick.recv(timeout=60)
        for one in many:
            one.close()
    wait_until(lambda: is_served(impatient))


def is_served(server: GuardedServer) -> bool:
    with suppress(ConnectionError):
        return get(server, "/", **cookie(server)).status == 200
    return False


def test_who_reads_nothing_is_sent_away_and_holds_up_nobody(impatient: GuardedServer):
    handle, live = cloud_of(impatient), impatient.viser._websock_server._live_connections
    deaf = look(impatient)
    with looking(impatient) as quick:
        wait_until(lambda: len(live) == 2)
        began, turns = time.monotonic(), 0
        while len(live) == 2:
            assert time.monotonic() - began < 60
            turns = max(turns, *drawn(handle, 2))
            assert quick.recv(timeout=60)
        assert next(iter(live.values())) is not deaf
        impatient.viser.scene.add_frame("/still")
        assert quick.recv(timeout=60)
    deaf.socket.close()


def test_who_reads_slowly_gets_all_of_it(impatient: GuardedServer, monkeypatch: pytest.MonkeyPatch):
    made = connection.Connection.connection_made

    def narrow(self: connection.Connection, transport: asyncio.BaseTransport) -> None:
        made(self, transport)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4608)

    monkeypatch.setattr(connection.Connection, "connection_made", narrow)
    body = bytes(400_000)
    impatient.pages["/large"] = lambda query: Answer(body)
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4608)
    client.connect(("127.0.0.1", port_of(impatient)))
    head = (
        f"GET /large HTTP/1.1\r\nHost: localhost\r\nCookie: {cookie(impatient)['Cookie']}\r\n\r\n"
    )
    client.sendall(head.encode())
    got = b""
    while piece := client.recv(4096):
        got += piece
        time.sleep(0.005)
    assert len(got.partition(b"\r\n\r\n")[2]) == len(body)


def test_memory_does_not_grow_by_who_reads_nothing(server: GuardedServer):
    handle = cloud_of(server)
    deaf = look(server)
    with looking(server) as quick:
        own, sizes = psutil.Process(), list[int]()
        for _ in range(3):
            for _ in drawn(handle, 20):
                assert quick.recv(timeout=60)
            sizes.append(own.memory_info().rss)
    deaf.socket.close()
    frame_bytes = POINTS * 15
    assert sizes[2] - sizes[1] < 5 * frame_bytes  # of the 20 frames that were drawn


def test_pings_of_one_that_reads_nothing_are_not_answered_for_ever(server: GuardedServer):
    handle = cloud_of(server)
    deaf = look(server)
    live = server.viser._websock_server._live_connections
    wait_until(lambda: bool(live))
    for _ in drawn(handle, 100):  # until it is more than the network takes
        time.sleep(0.02)
        if next(iter(live.values())).paused:
            break
    ping = b"\x89\xfd" + bytes(4) + b"x" * 125
    with suppress(ConnectionError):
        for _ in range(2000):
            deaf.socket.sendall(ping)
            time.sleep(0.0002)
    wait_until(lambda: not live)
    deaf.socket.close()


def click(client: ClientConnection, times: int = 1) -> None:
    message = {
        "type": "ScenePointerMessage",
        "event_type": "click",
        "ray_origin": [0.0, 0.0, 0.0],
        "ray_direction": [1.0, 0.0, 0.0],
        "screen_pos": [[0.5, 0.5]],
        "modifier": None,
    }
    with suppress(ConnectionClosed):
        for _ in range(times):
            client.send(msgspec.msgpack.encode(message))


def camera(client: ClientConnection) -> None:
    client.send(msgspec.msgpack.encode(CAMERA))


def test_who_clicks_without_end_is_heard_at_the_pace_of_a_hand(server: GuardedServer):
    clicks = list[int]()
    server.viser.scene.on_click()(lambda event: clicks.append(event.client_id))
    with looking(server) as flooding, looking(server) as calm:
        for client in (flooding, calm):
            camera(client)
        began = time.monotonic()
        flood = threading.Thread(target=click, args=(flooding, 200))
        flood.start()
        wait_until(lambda: len(clicks) >= listener.CLICK_PACE[1])
        click(calm)
        wait_until(lambda: len(set(clicks)) == 2)  # heard at once, though the other waits
        rate_hz, burst = listener.CLICK_PACE
        assert len(clicks) <= burst + 1 + rate_hz * (time.monotonic() - began) + 1
    flood.join()


def test_who_says_nothing_right_without_end_is_cut_off(server: GuardedServer):
    live = server.viser._websock_server._live_connections
    client = look(server)
    wait_until(lambda: bool(live))
    ends_s = time.monotonic() + 90

    def talk() -> None:
        with suppress(OSError):
            while time.monotonic() < ends_s:
                client.socket.sendall(b"\x82\x81\0\0\0\0x" * 1000)

    talking = threading.Thread(target=talk)
    talking.start()
    wait_until(lambda: not live)
    client.socket.close()
    talking.join()


def test_not_more_than_sixteen_come_at_the_same_moment(server: GuardedServer):
    clients, refused = list[ClientConnection](), list[str]()

    def come() -> None:
        try:
            clients.append(look(server))
        except Exception as error:  # of websockets: refused
            refused.append(type(error).__name__)

    together = [threading.Thread(target=come) for _ in range(40)]
    for thread in together:
        thread.start()
    for thread in together:
        thread.join()
    assert len(clients) + len(refused) == 40
    let_in = sum(_is_served(client) for client in clients)
    assert let_in == gate.MOST_CLIENTS
    for client in clients:
        client.socket.close()


def _is_served(client: ClientConnection) -> bool:
    try:
        return bool(client.recv(timeout=60))
    except ConnectionClosed:
        return False
