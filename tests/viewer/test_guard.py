"""Who is let in, judged by the headers alone."""

import pytest
from websockets.datastructures import Headers

from pseudolidar.viewer.guard import Admitted, Guard, Refused

GUARD = Guard(8080)
HOST = ("Host", "127.0.0.1:8080")
ORIGIN = ("Origin", "http://127.0.0.1:8080")
COOKIE = ("Cookie", f"{GUARD.cookie_name}={GUARD.session}")


def page(target: str, *headers: tuple[str, str], guard: Guard = GUARD) -> Admitted | Refused:
    return guard.page(target, Headers(headers))


def test_the_printed_address_is_let_in_and_exchanged_for_a_cookie():
    verdict = page(f"/?token={GUARD.token}", HOST)
    assert isinstance(verdict, Admitted)
    name, _, rest = verdict.cookie.partition("=")
    assert name == "pseudolidar_viewer_8080"
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(rest.split("; "))
    assert GUARD.token not in verdict.cookie


def test_the_cookie_is_enough_afterwards():
    assert page("/", HOST, COOKIE) == Admitted()
    assert page("/", HOST, ("Cookie", f"other=1; {COOKIE[1]}; more=2")) == Admitted()


def test_a_link_on_another_site_may_hold_the_token():
    assert isinstance(
        page(f"/?token={GUARD.token}", HOST, ("Sec-Fetch-Site", "cross-site")), Admitted
    )


@pytest.mark.parametrize(
    ("target", "headers"),
    [
        ("/", [HOST]),
        ("/?token=", [HOST]),
        ("/?token=wrong", [HOST]),
        ("/?token=wrong", [HOST, COOKIE]),
        (f"/?token={GUARD.token}x", [HOST]),
        (f"/?token={GUARD.token[:-1]}", [HOST]),
        (f"/?token={GUARD.session}", [HOST]),
        (f"/?TOKEN={GUARD.token}", [HOST]),
        (f"/?token={GUARD.token}&token={GUARD.token}", [HOST]),
        (f"/#?token={GUARD.token[:-1]}", [HOST]),
        ("/?token=\u00e4", [HOST]),
        ("/?" + "&".join(f"a{i}=1" for i in range(99)), [HOST, COOKIE]),
        (f"/?token={GUARD.token}", []),
        (f"/?token={GUARD.token}", [HOST, HOST]),
        (f"/?token={GUARD.token}", [("Host", "evil.example")]),
        (f"/?token={GUARD.token}", [("Host", "evil.example:8080")]),
        (f"/?token={GUARD.token}", [("Host", "127.0.0.1.evil.example:8080")]),
        (f"/?token={GUARD.token}", [("Host", "localhost@evil.example")]),
        (f"/?token={GUARD.token}", [("Host", "evil.example@localhost")]),
        (f"/?token={GUARD.token}", [("Host", "localhost/evil")]),
        (f"/?token={GUARD.token}", [("Host", "localhost:port")]),
        (f"/?token={GUARD.token}", [("Host", "192.168.1.2:8080")]),
        (f"/?token={GUARD.token}", [("Host", "")]),
        ("/", [HOST, ("Cookie", f"{GUARD.cookie_name}=")]),
        ("/", [HOST, ("Cookie", f"{GUARD.cookie_name}={GUARD.token}")]),
        ("/", [HOST, ("Cookie", f"x{GUARD.cookie_name}={GUARD.session}")]),
        ("/", [HOST, ("Cookie", f"pseudolidar_viewer_8081={GUARD.session}")]),
        ("/", [HOST, ("Cookie", f"{COOKIE[1]}; {GUARD.cookie_name}=planted")]),
        ("/", [HOST, COOKIE, COOKIE]),
        ("/", [HOST, COOKIE, ("Sec-Fetch-Site", "cross-site")]),
        ("/", [HOST, COOKIE, ("Sec-Fetch-Site", "same-site")]),
        ("/", [("Host", "evil.example"), COOKIE]),
    ],
    ids=lambda given: type(given).__name__,  # tokens are others in every process that runs tests
)
def test_pages_are_refused(target: str, headers: list[tuple[str, str]]):
    assert isinstance(page(target, *headers), Refused)


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:8080", "http://127.0.0.1:8080"),
        ("localhost:8080", "http://localhost:8080"),
        ("[::1]:8080", "http://[::1]:8080"),
        # Forwarded over SSH from another port, and behind a proxy that ends TLS.
        ("localhost:9000", "http://localhost:9000"),
        ("localhost", "https://localhost"),
    ],
)
def test_websockets_of_the_own_page_are_let_in(host: str, origin: str):
    headers = Headers([("Host", host), ("Origin", origin), COOKIE])
    assert GUARD.websocket(headers) == Admitted()


@pytest.mark.parametrize(
    "headers",
    [
        [HOST, ORIGIN],
        [HOST, COOKIE],
        [HOST, COOKIE, ("Origin", "null")],
        [HOST, COOKIE, ("Origin", "http://evil.example")],
        [HOST, COOKIE, ("Origin", "http://127.0.0.1:8081")],
        [HOST, COOKIE, ("Origin", "http://localhost:8080")],
        [HOST, COOKIE, ("Origin", "file://127.0.0.1:8080")],
        [HOST, COOKIE, ORIGIN, ORIGIN],
        [("Host", "evil.example"), COOKIE, ("Origin", "http://evil.example")],
        [ORIGIN, COOKIE],
    ],
)
def test_websockets_of_others_are_refused(headers: list[tuple[str, str]]):
    assert isinstance(GUARD.websocket(Headers(headers)), Refused)


def test_other_machines_come_by_names_that_were_given_and_by_numbers():
    guard = Guard(8080, names=("robot.local",))
    target = f"/?token={guard.token}"
    for host in ("robot.local:8080", "10.0.0.7:8080", "[fe80::1]:8080", "localhost:8080"):
        assert isinstance(page(target, ("Host", host), guard=guard), Admitted)
    for host in ("robot.evil:8080", "10.0.0.7.evil.example:8080"):
        assert isinstance(page(target, ("Host", host), guard=guard), Refused)


def test_tokens_are_not_shown():
    assert GUARD.token not in repr(GUARD)
    assert GUARD.session not in repr(GUARD)
    assert Guard(1).token != Guard(1).token
