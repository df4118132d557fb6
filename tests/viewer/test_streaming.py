"""Files that are longer than the memory: sent as they are taken, and nobody waits for them."""

from __future__ import annotations

import http.client
import socket
import threading
import time
from collections.abc import Generator, Iterator

import pytest

from pseudolidar.viewer import connection, streaming
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.server import GuardedServer, serve
from tests.viewer.clients import cookie, get, port_of, wait_until

PIECE, COUNT = bytes(range(256)) * 4096, 40


class Body:
    """Pieces, and how many of them were made; one that breaks, if it is told so."""

    def __init__(self, breaks_at: int = -1) -> None:
        self.made, self.ended, self._breaks_at = 0, threading.Event(), breaks_at

    def answer(self, _query: object) -> Answer:
        return Answer(
            b"", "x/y", download="a.bin", pieces=self._pieces(), length=len(PIECE) * COUNT
        )

    def _pieces(self) -> Generator[bytes]:
        try:
            for number in range(COUNT):
                if number == self._breaks_at:
                    raise ZeroDivisionError
                self.made += 1
                yield PIECE
        finally:
            self.ended.set()


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[GuardedServer]:
    monkeypatch.setattr(connection, "PATIENCE_S", 1.0)
    started = serve(Address(port=0), label="streams")
    yield started
    started.stop()


def asked(server: GuardedServer, target: str) -> socket.socket:
    """A request of somebody who reads nothing."""
    line = f"GET {target} HTTP/1.1\r\nHost: localhost\r\nCookie: {cookie(server)['Cookie']}\r\n\r\n"
    client = socket.create_connection(("127.0.0.1", port_of(server)), timeout=10)
    client.sendall(line.encode())
    return client


def test_a_long_file_comes_whole(server: GuardedServer):
    body = Body()
    server.pages["/long"] = body.answer
    answer = get(server, "/long", **cookie(server))
    assert (answer.status, answer.getheader("Content-Type")) == (200, "x/y")
    assert answer.getheader("Content-Disposition") == 'attachment; filename="a.bin"'
    assert answer.getheader("Content-Security-Policy")
    assert answer.read() == PIECE * COUNT
    assert body.ended.is_set()
    assert get(server, "/long?token=x", **cookie(server)).status == 403


def test_who_takes_nothing_costs_a_piece_and_is_closed(server: GuardedServer):
    body = Body()
    server.pages["/long"], server.pages["/own"] = body.answer, lambda _query: Answer(b"{}")
    deaf = asked(server, "/long")
    wait_until(lambda: body.made > 0)
    assert get(server, "/own", **cookie(server)).status == 200
    assert body.ended.wait(60)
    assert body.made < COUNT  # what the network holds, and one more
    deaf.close()


def test_who_goes_away_ends_it(server: GuardedServer):
    body = Body()
    server.pages["/long"] = body.answer
    client = asked(server, "/long")
    assert client.recv(4096)
    client.close()
    assert body.ended.wait(60)
    assert body.made < COUNT


def test_a_file_that_breaks_is_seen_to_be_not_whole(
    server: GuardedServer, caplog: pytest.LogCaptureFixture
):
    server.pages["/long"] = Body(breaks_at=3).answer
    answer = get(server, "/long", **cookie(server))
    with pytest.raises((http.client.IncompleteRead, ConnectionError)):
        answer.read()
    assert "ZeroDivisionError" in caplog.text
    server.pages["/long"] = Body().answer
    assert len(get(server, "/long", **cookie(server)).read()) == len(PIECE) * COUNT


def test_more_than_may_be_sent_at_once_have_to_come_later(server: GuardedServer):
    bodies = [Body() for _ in range(streaming.AT_ONCE)]
    for number, body in enumerate(bodies):
        server.pages[f"/long{number}"] = body.answer
    deaf = [asked(server, f"/long{number}") for number in range(streaming.AT_ONCE)]
    wait_until(lambda: all(body.made for body in bodies))
    assert get(server, "/long0", **cookie(server)).status == 503
    for one in deaf:
        one.close()
    wait_until(lambda: all(body.ended.is_set() for body in bodies))
    end_s = time.monotonic() + 60
    while get(server, "/long0", **cookie(server)).status == 503:
        assert time.monotonic() < end_s
