"""A real server, and what the network gets out of it."""

from __future__ import annotations

import http.client
import logging
import socket
import time
from contextlib import ExitStack, suppress
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest
import websockets.asyncio.server
from playwright.sync_api import Page
from websockets.exceptions import ConnectionClosed, InvalidStatus

from pseudolidar.errors import ServeError
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.gate import MOST_CLIENTS
from pseudolidar.viewer.server import GuardedServer, serve
from tests.viewer.clients import cookie, get, look, looking, port_of, wait_until


def test_the_printed_address_answers_and_gives_a_cookie(server: GuardedServer):
    target = urlsplit(server.url)
    answer = get(server, f"{target.path}?{target.query}")
    assert answer.status == 200
    assert b"<title>Viser</title>" in answer.read()
    given = answer.getheader("Set-Cookie") or ""
    assert given.startswith(f"pseudolidar_viewer_{port_of(server)}=")
    assert "HttpOnly" in given
    assert "SameSite=Strict" in given
    assert get(server, "/", Cookie=given.split(";")[0]).status == 200


def test_every_answer_keeps_the_page_to_itself(server: GuardedServer):
    server.pages["/own"] = lambda query: Answer(b"{}")
    for target, framed in (("/", "'none'"), ("/own", "'self'"), ("/nothing", "'none'")):
        answer = get(server, target, **cookie(server))
        policy = answer.getheader("Content-Security-Policy") or ""
        assert f"frame-ancestors {framed}" in policy
        assert "default-src 'none'" in policy
        assert answer.getheader("X-Content-Type-Options") == "nosniff"
        assert answer.getheader("Referrer-Policy") == "no-referrer"
        assert answer.getheader("Server") is None


def test_a_client_that_asks_again_does_so_on_a_connection_that_is_there(server: GuardedServer):
    server.pages["/own"] = lambda query: Answer(b"{}")
    client = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=10)
    asked = [("/own", cookie(server), 200), ("/", cookie(server), 200), ("/own", {}, 403)] * 2
    for target, headers, status in asked:
        client.request("GET", target, headers=headers)
        answer = client.getresponse()
        answer.read()
        assert answer.status == status
    client.close()


@pytest.mark.parametrize(
    "target",
    [
        "/index.html",
        "/../pyproject.toml",
        "/..%2f..%2fetc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/..\\..\\etc\\passwd",
        "//etc/passwd",
        "/.git/config",
        "/own/../own",
        "/own%00",
        "/OWN",
    ],
)
def test_nothing_but_its_pages_is_served(server: GuardedServer, target: str):
    server.pages["/own"] = lambda query: Answer(b"{}")
    assert get(server, target, **cookie(server)).status == 404
    assert get(server, target).status == 403


def test_pages_get_their_query(server: GuardedServer):
    server.pages["/own"] = lambda query: Answer(repr(sorted(query.items())).encode())
    assert get(server, "/own?x=1&y=a%20b", **cookie(server)).read() == b"[('x', '1'), ('y', 'a b')]"
    many = "&".join(f"a{i}=1" for i in range(40))
    assert get(server, f"/own?{many}", **cookie(server)).status == 400


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS", "CONNECT"])
def test_other_methods_get_nothing(server: GuardedServer, method: str):
    with socket.create_connection(("127.0.0.1", port_of(server)), timeout=10) as raw:
        raw.sendall(f"{method} / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n".encode())
        answer = raw.recv(4096)
    assert b" 200 " not in answer.split(b"\r\n")[0]


@pytest.mark.parametrize(
    "sent", [b"\x00" * 100, b"GET / HTTP/1.1\r\n" + b"a" * 100_000, b"\r\n\r\n"]
)
def test_what_is_no_http_gets_nothing(server: GuardedServer, sent: bytes):
    with socket.create_connection(("127.0.0.1", port_of(server)), timeout=10) as raw:
        raw.sendall(sent)
        raw.shutdown(socket.SHUT_WR)
        answer = b""
        with suppress(ConnectionResetError):
            answer = raw.recv(4096)
    assert b" 200 " not in answer
    assert get(server, "/", **cookie(server)).status == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Cookie": ""},
        {"Cookie": "pseudolidar_viewer_1=x"},
        {"Origin": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
    ],
)
def test_websockets_of_others_are_refused_before_they_open(
    server: GuardedServer, headers: dict[str, str]
):
    with pytest.raises(InvalidStatus) as refused:
        look(server, **headers)
    assert refused.value.response.status_code == 403


def test_a_websocket_of_the_page_is_opened(server: GuardedServer):
    server.viser.scene.add_frame("/there")
    with looking(server) as socket_:
        assert len(socket_.recv(timeout=60)) > 16


def test_not_more_than_sixteen_look_at_once(server: GuardedServer):
    with ExitStack() as stack:
        for _ in range(MOST_CLIENTS):
            stack.enter_context(look(server))
        with pytest.raises(InvalidStatus) as refused:
            look(server)
        assert refused.value.response.status_code == 503
    wait_until(lambda: not server.viser._websock_server._live_connections)
    look(server).close()


def test_a_share_tunnel_cannot_be_asked_for(
    server: GuardedServer, caplog: pytest.LogCaptureFixture
):
    with caplog.at_level(logging.WARNING), look(server) as socket_:
        socket_.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        wait_until(lambda: "ShareUrlRequest" in caplog.text)
    assert server.viser._share_tunnel is None
    assert server.viser.request_share_url() is None


def test_values_of_the_wrong_kind_change_nothing(server: GuardedServer):
    slider = server.viser.gui.add_slider("s", min=0, max=10, step=1, initial_value=5)
    hidden = server.viser.gui.add_number("h", initial_value=1, disabled=True)
    with looking(server) as socket_:
        for uuid, updates in (
            (slider._impl.uuid, {"value": 99}),
            (slider._impl.uuid, {"value": "7"}),
            (slider._impl.uuid, {"update_cb": []}),
            (hidden._impl.uuid, {"value": 2}),
            (slider._impl.uuid, {"value": 7}),
        ):
            message = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}
            socket_.send(msgspec.msgpack.encode(message))
        wait_until(lambda: slider.value == 7)
    assert hidden.value == 1
    assert slider._impl.update_cb == []


def test_one_that_sends_garbage_is_sent_away_and_others_stay(server: GuardedServer):
    rng = np.random.default_rng(0)
    with looking(server) as quiet, looking(server) as loud:
        for _ in range(1000):
            try:
                loud.send(rng.bytes(int(rng.integers(1, 400))))
            except ConnectionClosed:
                break
            time.sleep(0.001)
        else:
            pytest.fail("still listened to")
        server.viser.scene.add_frame("/still")
        assert quiet.recv(timeout=60)


def test_a_client_that_reads_nothing_holds_up_nobody(server: GuardedServer):
    deaf = look(server)
    with looking(server) as quick:
        handle = server.viser.scene.add_point_cloud(
            "/cloud", np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
        )
        for turn in range(5):
            handle.points = np.full((500_000, 3), turn, np.float32)
            assert quick.recv(timeout=60)
    deaf.socket.close()


def test_a_port_in_use_is_an_error_and_no_other_port(server: GuardedServer):
    with pytest.raises(ServeError) as taken:
        serve(Address(port=port_of(server)), label="second")
    assert "in use" in taken.value.got
    assert str(port_of(server)) in str(taken.value)


@pytest.mark.parametrize("host", ["203.0.113.7", "no.such.host.invalid"])
def test_a_host_that_is_not_this_machine_is_an_error_at_once(host: str):
    began = time.monotonic()
    with pytest.raises(ServeError):
        serve(Address(host=host, port=0), label="elsewhere")
    assert time.monotonic() - began < 2


def test_it_listens_at_loopback_alone(server: GuardedServer):
    # 127.0.0.2 is this machine, too, and would be reached were every address listened at.
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", port_of(server)), timeout=2)


def test_viser_is_as_it_was_for_others(server: GuardedServer):
    assert websockets.asyncio.server.serve.__module__.startswith("websockets")


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]):
    started = serve(Address(port=0), label="quiet")
    look(started).close()
    started.stop()
    printed = capfd.readouterr()
    assert "token" not in printed.out + printed.err
    assert printed.out == ""


def test_a_browser_sees_the_scene(server: GuardedServer, page: Page):
    server.viser.gui.add_markdown("here it is")
    answer = page.goto(server.url)
    assert answer is not None
    assert answer.status == 200
    page.get_by_text("here it is").wait_for(timeout=60_000)


def test_a_browser_without_token_sees_nothing(server: GuardedServer, page: Page):
    answer = page.goto(server.url.split("?")[0])
    assert answer is not None
    assert answer.status == 403
    assert page.content().count("viser") == 0
