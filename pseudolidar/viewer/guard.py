"""Who may look: a token in the printed address, a cookie after it, and no page but our own."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Protocol
from urllib.parse import parse_qs, urlsplit

# Bytes of chance in a token: nobody guesses it.
TOKEN_BYTES = 32
# Parts of a query that is looked at for a token.
MOST_PARTS = 64
# Names of this very machine, which no other site can put into a request of a browser.
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")
# A page of another site says so in this header; what a person types says `none`.
OWN_FETCHES = ("same-origin", "none")


class Headers(Protocol):
    """Headers of a request: every value of a name, whatever its case."""

    def get_all(self, key: str) -> Sequence[str]:
        """All values."""
        ...


@dataclass(frozen=True)
class Admitted:
    """Let in.

    Args:
        cookie: value of `Set-Cookie` to send, where a token was just exchanged; else "".
    """

    cookie: str = ""


@dataclass(frozen=True)
class Refused:
    """Not let in.

    Args:
        why: one line for the log; the client learns the status alone.
        status: of HTTP.
    """

    why: str
    status: HTTPStatus = HTTPStatus.FORBIDDEN


@dataclass(frozen=True)
class Guard:
    """Judges each request by what it brings, before anything is done for it.

    A request needs a known `Host`, and the token in its query or the cookie that was given for it.
    A websocket needs the cookie and an `Origin` that is the page of this very host. The port in
    `Host` may differ: that is what forwarding over SSH does.

    Args:
        port: that it listens at; part of the cookie's name, since cookies ignore ports.
        names: what `Host` may be, without port, besides loopback names and numbers of IP, which
            no name server can bend.
        token: what the printed address holds.
        session: what the cookie holds: the token itself is not kept in the browser.
    """

    port: int
    names: tuple[str, ...] = ()
    token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES), repr=False)
    session: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES), repr=False)

    @property
    def cookie_name(self) -> str:
        """Name of the cookie."""
        return f"pseudolidar_viewer_{self.port}"

    @property
    def cookie(self) -> str:
        """Value of `Set-Cookie`."""
        return f"{self.cookie_name}={self.session}; Path=/; HttpOnly; SameSite=Strict"

    def page(self, target: str, headers: Headers) -> Admitted | Refused:
        """Judge a request for a page or a part of it.

        Args:
            target: path and query as they were sent.
            headers: of the request.
        """
        if refused := self._foreign_host(headers):
            return refused
        given = _token_of(target)
        if given is not None:
            right = _same(given, self.token)
            return Admitted(self.cookie) if right else Refused("wrong token")
        if any(value not in OWN_FETCHES for value in headers.get_all("Sec-Fetch-Site")):
            return Refused("asked for by another site")
        return Admitted() if self._has_cookie(headers) else Refused("neither token nor cookie")

    def websocket(self, headers: Headers) -> Admitted | Refused:
        """Judge a request to open a websocket, before it is opened."""
        if refused := self._foreign_host(headers):
            return refused
        (host,), origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(origins) != 1 or origins[0] not in (f"http://{host}", f"https://{host}"):
            return Refused("a websocket of another page")
        return Admitted() if self._has_cookie(headers) else Refused("a websocket without cookie")

    def _foreign_host(self, headers: Headers) -> Refused | None:
        hosts = headers.get_all("Host")
        if len(hosts) != 1 or not self._known(hosts[0]):
            return Refused("a host that this is not")
        return None

    def _known(self, host: str) -> bool:
        try:
            parts = urlsplit(f"//{host}")
            name, _ = parts.hostname, parts.port
        except ValueError:
            return False
        if name is None or parts.netloc != host or "@" in host or parts.path or parts.query:
            return False
        return name in LOOPBACK_NAMES or name in self.names or _is_number_of(name, self.names)

    def _has_cookie(self, headers: Headers) -> bool:
        pieces = (piece.strip() for line in headers.get_all("Cookie") for piece in line.split(";"))
        pairs = (piece.partition("=") for piece in pieces)
        found = [value for name, _, value in pairs if name == self.cookie_name]
        # Two of one name: one of them was put there by somebody else.
        return len(found) == 1 and _same(found[0], self.session)


def _same(given: str, secret: str) -> bool:
    """Whether they are the same, in a time that tells nothing; bytes of no text are just wrong."""
    return hmac.compare_digest(given.encode(errors="surrogatepass"), secret.encode())


def _token_of(target: str) -> str | None:
    try:
        query = target.partition("?")[2]
        given = parse_qs(query, keep_blank_values=True, max_num_fields=MOST_PARTS).get("token")
    except ValueError:
        return ""
    # Two tokens are none.
    return None if given is None else given[0] if len(given) == 1 else ""


def _is_number_of(name: str, names: tuple[str, ...]) -> bool:
    """Whether `name` is an IP number, where others than this machine may look at all."""
    if not names:
        return False
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
