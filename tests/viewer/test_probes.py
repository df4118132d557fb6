"""Ways in that are tried on a real server: none of them may open.

One server for all. A probe is bytes on the network; what is let in answers 200 or 101.
"""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from pseudolidar.viewer.address import Address
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.connection import MOST_PIECES
from pseudolidar.viewer.inbound import MESSAGE_BYTES
from pseudolidar.viewer.server import GUARDED_VERSION, GuardedServer, serve
from tests.viewer.clients import cookie, get, look, looking, port_of, wait_until

KEY = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="
SPOKEN = f"Sec-WebSocket-Protocol: viser-v{GUARDED_VERSION}"


@pytest.fixture(scope="module")
def server() -> Iterator[GuardedServer]:
    started = serve(Address(port=0), label="probed")
    started.pages["/own"] = lambda query: Answer(b"{}")
    yield started
    started.stop()


def asked(server: GuardedServer, *lines: str | bytes) -> int:
    """Status of what a request of these lines gets; 0 where the connection is just closed.

    $PORT, $TOKEN, $COOKIE stand for those of the server.
    """
    names = {
        b"$PORT": str(port_of(server)).encode(),
        b"$TOKEN": server.guard.token.encode(),
        b"$COOKIE": cookie(server)["Cookie"].encode(),
    }
    sent = b"".join(
        (line if isinstance(line, bytes) else line.encode()) + b"\r\n" for line in lines
    )
    for name, value in names.items():
        sent = sent.replace(name, value)
    with socket.create_connection(("127.0.0.1", port_of(server)), timeout=1) as raw:
        answer = b""
        with suppress(ConnectionError, TimeoutError):  # it may wait for more
            raw.sendall(sent + b"\r\n")
            answer = raw.recv(4096)
    return int(answer.split()[1]) if answer.startswith(b"HTTP/1.1 ") else 0


HOST = "Host: 127.0.0.1:$PORT"
GOOD = (HOST, "Cookie: $COOKIE")
UPGRADE = ("Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13", KEY, SPOKEN)
ORIGIN = "Origin: http://127.0.0.1:$PORT"

PAGES: dict[str, tuple[str | bytes, ...]] = {
    # --- token
    "no token": ("GET / HTTP/1.1", HOST),
    "empty token": ("GET /?token= HTTP/1.1", HOST),
    "wrong token": ("GET /?token=AAAA HTTP/1.1", HOST),
    "short token": ("GET /?token=$TOKENx HTTP/1.1", HOST),
    "token twice": ("GET /?token=$TOKEN&token=$TOKEN HTTP/1.1", HOST),
    "token in the path": ("GET /$TOKEN HTTP/1.1", HOST),
    "token after a hash": ("GET /#token=$TOKEN HTTP/1.1", HOST),
    "token as a parameter of the path": ("GET /;token=$TOKEN HTTP/1.1", HOST),
    "token in a header": ("GET / HTTP/1.1", HOST, "Authorization: Bearer $TOKEN"),
    "token in the referrer": ("GET / HTTP/1.1", HOST, "Referer: http://localhost/?token=$TOKEN"),
    "token as a cookie": ("GET / HTTP/1.1", HOST, "Cookie: token=$TOKEN"),
    "token in a body": ("GET / HTTP/1.1", HOST, "Content-Length: 5", "", "token=$TOKEN"),
    "token in capitals": ("GET /?Token=$TOKEN HTTP/1.1", HOST),
    "token with a zero byte": ("GET /?token=$TOKEN%00 HTTP/1.1", HOST),
    "token of no text": (b"GET /?token=\xff\xfe HTTP/1.1", HOST),
    "token of percent bytes": ("GET /?token=%ff%fe HTTP/1.1", HOST),
    "wrong token with the cookie": ("GET /?token=AAAA HTTP/1.1", *GOOD),
    # --- cookie
    "cookie of no text": (b"GET / HTTP/1.1", HOST, b"Cookie: $COOKIE\xff"),
    "cookie with more": ("GET / HTTP/1.1", HOST, "Cookie: $COOKIEx"),
    "cookie in quotes": ("GET / HTTP/1.1", HOST, 'Cookie: a="$COOKIE"'),
    "cookie by commas": ("GET / HTTP/1.1", HOST, "Cookie: a=1,$COOKIE"),
    "cookie twice": ("GET / HTTP/1.1", *GOOD, "Cookie: $COOKIE"),
    "cookie as another header": ("GET / HTTP/1.1", HOST, "Cookie2: $COOKIE"),
    "cookie in the query": ("GET /?$COOKIE HTTP/1.1", HOST),
    # --- host
    "no host": ("GET / HTTP/1.1", "Cookie: $COOKIE"),
    "foreign host": ("GET /?token=$TOKEN HTTP/1.1", "Host: evil.example"),
    "foreign host of a proxy": ("GET / HTTP/1.1", "Host: evil.example", "X-Forwarded-Host: ::1"),
    "two hosts": ("GET / HTTP/1.1", *GOOD, "Host: evil.example"),
    "host of a whole address": ("GET http://localhost/ HTTP/1.1", "Host: evil.example"),
    "host with a user": ("GET / HTTP/1.1", "Host: localhost@evil.example", "Cookie: $COOKIE"),
    "host that begins right": ("GET / HTTP/1.1", "Host: localhost.evil.example", "Cookie: $COOKIE"),
    "host of no text": (b"GET / HTTP/1.1", b"Host: \xff\xfe", "Cookie: $COOKIE"),
    "host of a number": ("GET / HTTP/1.1", "Host: 2130706433", "Cookie: $COOKIE"),
    # --- other sites
    "fetched by another site": ("GET / HTTP/1.1", *GOOD, "Sec-Fetch-Site: cross-site"),
    "fetched by a sister": ("GET / HTTP/1.1", *GOOD, "Sec-Fetch-Site: same-site"),
    # --- paths
    "up": ("GET /../../etc/passwd HTTP/1.1", *GOOD),
    "up in percents": ("GET /%2e%2e/%2e%2e/etc/passwd HTTP/1.1", *GOOD),
    "up in mixed percents": ("GET /..%2f..%2fetc%2fpasswd HTTP/1.1", *GOOD),
    "up in double percents": ("GET /%252e%252e/%252e%252e/etc/passwd HTTP/1.1", *GOOD),
    "up in backslashes": ("GET /..\\..\\etc\\passwd HTTP/1.1", *GOOD),
    "up in overlong bytes": ("GET /%c0%ae%c0%ae/etc/passwd HTTP/1.1", *GOOD),
    "up from a page": ("GET /own/../../pyproject.toml HTTP/1.1", *GOOD),
    "another root": ("GET //etc/passwd HTTP/1.1", *GOOD),
    "a file address": ("GET file:///etc/passwd HTTP/1.1", *GOOD),
    "a zero byte": ("GET /own%00.html HTTP/1.1", *GOOD),
    "a hidden file": ("GET /.git/config HTTP/1.1", *GOOD),
    "a file of viser": ("GET /index.html HTTP/1.1", *GOOD),
    "a folder of viser": ("GET /assets HTTP/1.1", *GOOD),
    "nothing": ("GET  HTTP/1.1", *GOOD),
    # --- HTTP
    "POST": ("POST / HTTP/1.1", *GOOD),
    "PUT": ("PUT /own HTTP/1.1", *GOOD),
    "DELETE": ("DELETE /own HTTP/1.1", *GOOD),
    "TRACE": ("TRACE / HTTP/1.1", *GOOD),
    "CONNECT": ("CONNECT 10.0.0.1:80 HTTP/1.1", *GOOD),
    "HTTP/1.0": ("GET / HTTP/1.0", *GOOD),
    "HTTP/2": (b"PRI * HTTP/2.0", b"", b"SM"),
    "TLS": (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",),
    "a line too long": (f"GET /{'a' * 9000} HTTP/1.1", *GOOD),
    "a header too long": ("GET / HTTP/1.1", *GOOD, f"X: {'a' * 9000}"),
    "too many headers": ("GET / HTTP/1.1", *GOOD, *(f"X-{i}: 1" for i in range(200))),
    "a header without name": ("GET / HTTP/1.1", *GOOD, ": 1"),
    "a header folded": ("GET / HTTP/1.1", *GOOD, "X: a", " b"),
    "a body in pieces": ("GET / HTTP/1.1", *GOOD, "Transfer-Encoding: chunked"),
    "a body of any length": ("GET / HTTP/1.1", *GOOD, "Content-Length: 999999999999"),
}  # fmt: skip

WEBSOCKETS: dict[str, tuple[str | bytes, ...]] = {
    "no cookie": (HOST, ORIGIN, *UPGRADE),
    "the token alone": (HOST, ORIGIN, *UPGRADE, "Authorization: Bearer $TOKEN"),
    "no origin": (*GOOD, *UPGRADE),
    "origin null": (*GOOD, "Origin: null", *UPGRADE),
    "foreign origin": (*GOOD, "Origin: https://evil.example", *UPGRADE),
    "origin of another port": (*GOOD, "Origin: http://127.0.0.1:1", *UPGRADE),
    "origin of another name": (*GOOD, "Origin: http://localhost:$PORT", *UPGRADE),
    "origin that begins right": (*GOOD, "Origin: http://127.0.0.1:$PORT.evil.example", *UPGRADE),
    "origin of a file": (*GOOD, "Origin: file://", *UPGRADE),
    "two origins": (*GOOD, ORIGIN, "Origin: http://evil.example", *UPGRADE),
    "foreign host with its own origin": (
        "Host: evil.example", "Origin: http://evil.example", "Cookie: $COOKIE", *UPGRADE,
    ),
    "no version": (*GOOD, ORIGIN, *UPGRADE[:2], KEY, SPOKEN),
    "old version": (*GOOD, ORIGIN, *UPGRADE[:2], "Sec-WebSocket-Version: 8", KEY, SPOKEN),
    "no key": (*GOOD, ORIGIN, *UPGRADE[:3], SPOKEN),
    "no protocol": (*GOOD, ORIGIN, *UPGRADE[:4]),
    "another protocol": (*GOOD, ORIGIN, *UPGRADE[:4], "Sec-WebSocket-Protocol: viser-v[red]"),
    "two upgrades": (*GOOD, *UPGRADE, "Upgrade: h2c"),
    "capitals": (HOST, "Connection: upgrade", "Upgrade: WebSocket", *UPGRADE[2:]),
}  # fmt: skip


@pytest.mark.parametrize("probe", PAGES)
def test_no_page_answers(server: GuardedServer, probe: str):
    assert asked(server, *PAGES[probe]) not in (200, 101)


@pytest.mark.parametrize("probe", WEBSOCKETS)
def test_no_websocket_opens(server: GuardedServer, probe: str):
    assert asked(server, "GET / HTTP/1.1", *WEBSOCKETS[probe]) not in (200, 101)


def test_the_same_requests_done_right_are_let_in(server: GuardedServer):
    assert asked(server, "GET / HTTP/1.1", *GOOD) == 200
    assert asked(server, "GET /?token=$TOKEN HTTP/1.1", HOST) == 200
    assert asked(server, "GET /own HTTP/1.1", *GOOD) == 200
    assert asked(server, "GET / HTTP/1.1", *GOOD, ORIGIN, *UPGRADE) == 101


def test_of_two_upgrades_neither_is_taken_for_a_page(server: GuardedServer):
    assert asked(server, "GET / HTTP/1.1", *WEBSOCKETS["two upgrades"]) == 403


def frame(opcode: int, data: bytes, *, fin: bool = True, masked: bool = True) -> bytes:
    """A frame of a client, right or wrong: masked with zeros."""
    size = len(data) if len(data) < 126 else 126 if len(data) < 1 << 16 else 127
    head = bytes((opcode | 0x80 * fin, size | 0x80 * masked))
    longer = {126: ">H", 127: ">Q"}.get(size)
    return head + (struct.pack(longer, len(data)) if longer else b"") + bytes(4 * masked) + data


def end_of(client: ClientConnection) -> None:
    """Read until the connection is closed."""
    while True:
        client.recv(timeout=60)


TEXT, BINARY, CLOSE, PING, COMPRESSED = 1, 2, 8, 9, 0x42
EMPTY_LISTS = b"\xdd\x00\x10\x00\x00" + b"\x90" * (1 << 20)
FRAMES: dict[str, bytes] = {
    "not masked": frame(BINARY, b"x", masked=False),
    "compressed, which was not agreed": frame(COMPRESSED, b"\x4a\x04\x00"),
    "an unknown kind": frame(3, b"x"),
    "a longer ping than there is": frame(PING, b"x" * 128),
    "a ping in pieces": frame(PING, b"", fin=False),
    "a piece of nothing": frame(0, b"x"),
    "a new message within one": 2 * frame(BINARY, b"x", fin=False),
    "text that is none": frame(TEXT, b"\xff\xfe\xed\xa0\x80"),
    "a claim of 2^63 bytes": b"\x82\xff\x80\x00\x00\x00\x00\x00\x00\x00abcd",
    "a claim of a gigabyte": b"\x82\xff\x00\x00\x00\x00\x40\x00\x00\x00abcd",
    "a megabyte of empty lists": frame(BINARY, EMPTY_LISTS),
    "a message too long in pieces": frame(BINARY, b"x" * MESSAGE_BYTES, fin=False)
    + frame(0, b"xx"),
    "pieces without end": frame(BINARY, b"", fin=False)
    + frame(0, b"", fin=False) * (2 * MOST_PIECES),
    "a close of one byte": frame(CLOSE, b"x"),
    "a close with a reason of no text": frame(CLOSE, b"\x03\xe8\xff\xfe"),
}


@pytest.mark.parametrize("probe", FRAMES)
def test_broken_frames_end_their_connection_and_no_other(server: GuardedServer, probe: str):
    with looking(server) as quiet, looking(server) as loud:
        with suppress(ConnectionError):  # closed while it was sent
            loud.socket.sendall(FRAMES[probe])
        with pytest.raises(ConnectionClosed):
            end_of(loud)
        server.viser.scene.add_frame("/still")
        assert quiet.recv(timeout=60)


def test_a_half_open_connection_is_closed(server: GuardedServer):
    live = server.viser._websock_server._live_connections
    wait_until(lambda: not live)
    client = look(server)
    wait_until(lambda: bool(live))
    client.socket.shutdown(socket.SHUT_WR)
    wait_until(lambda: not live)
    client.socket.close()


def test_a_page_that_fails_tells_nothing(server: GuardedServer):
    server.pages["/fails"] = lambda query: Answer(str(1 / 0).encode())
    answer = get(server, "/fails", **cookie(server))
    assert answer.status == 500
    assert answer.getheader("Content-Security-Policy")
    assert answer.read() == b"500 Internal Server Error\n"


def test_pages_that_take_long_hold_up_no_others(server: GuardedServer):
    enough = threading.Event()
    server.pages["/slow"] = lambda query: Answer(str(enough.wait(10)).encode())
    request = f"GET /slow HTTP/1.1\r\nHost: localhost\r\nCookie: {cookie(server)['Cookie']}\r\n\r\n"
    waiting = [socket.create_connection(("127.0.0.1", port_of(server))) for _ in range(90)]
    for one in waiting:
        one.sendall(request.encode())
    wait_until(lambda: _refused_of(waiting) >= 20)  # more than may wait are told so at once
    assert get(server, "/own", **cookie(server)).status == 200
    enough.set()
    for one in waiting:
        one.close()


def _refused_of(connections: list[socket.socket]) -> int:
    for one in connections:
        one.setblocking(False)
    count = 0
    for one in connections:
        with suppress(BlockingIOError):
            count += one.recv(64, socket.MSG_PEEK).startswith(b"HTTP/1.1 503")
    return count
