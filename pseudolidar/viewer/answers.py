"""What is sent to browsers, and the headers that keep it to them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import TYPE_CHECKING

from pseudolidar.viewer.guard import Admitted, Refused

if TYPE_CHECKING:
    from websockets.http11 import Response

_log = logging.getLogger(__name__)

# What a page may load: itself. viser's page is one file with its scripts inside, and decodes in
# WebAssembly and workers; other addresses, Draco's decoder among them, are out of reach.
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "media-src 'self' blob:",
        "worker-src 'self' blob:",
        "connect-src 'self' data: blob:",
        "frame-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
    )
)

# A page of our own: what it answers to a query.
Page = Callable[[Mapping[str, str]], "Answer"]


@dataclass(frozen=True)
class Answer:
    """What a page of our own sends.

    Args:
        body: its bytes.
        kind: its MIME type.
        status: of HTTP.
        download: name of the file to save it as; "" to show it.
        pieces: of a body that is too long for the memory, in place of it; each is made when the
            one before was taken.
        length: bytes of all pieces.
    """

    body: bytes
    kind: str = "application/json"
    status: HTTPStatus = HTTPStatus.OK
    download: str = ""
    pieces: Generator[bytes] | None = None
    length: int = 0


def status_alone(status: HTTPStatus) -> Answer:
    """An answer that says nothing else."""
    return Answer(f"{status.value} {status.phrase}\n".encode(), "text/plain", status)


def refusal(refused: Refused) -> Response:
    """What one gets who is not let in; the log is told why."""
    _log.info("refused: %s", refused.why)
    return closed_in(response(status_alone(refused.status)), framed="'none'")


def response(answer: Answer) -> Response:
    """An answer as websockets sends it."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    length = len(answer.body) if answer.pieces is None else answer.length
    headers = Headers({"Content-Type": answer.kind, "Content-Length": str(length)})
    if answer.download:
        headers["Content-Disposition"] = f'attachment; filename="{answer.download}"'
    return Response(answer.status.value, answer.status.phrase, headers, answer.body)


def with_cookie(sent: Response, admitted: Admitted) -> Response:
    """The same with the cookie that a token was just exchanged for, if it was."""
    if admitted.cookie:
        sent.headers["Set-Cookie"] = admitted.cookie
    return sent


def closed_in(sent: Response, *, framed: str) -> Response:
    """The same with headers that keep a page to itself, and say that no other one follows.

    websockets ends a connection behind its answer; a client that is not told asks once more on it,
    now and then before it sees the end.

    Args:
        sent: of any page.
        framed: who may show it within a page: "'none'" or "'self'".
    """
    sent.headers["Content-Security-Policy"] = f"{POLICY}; frame-ancestors {framed}"
    sent.headers["X-Frame-Options"] = "DENY" if framed == "'none'" else "SAMEORIGIN"
    sent.headers["X-Content-Type-Options"] = "nosniff"
    sent.headers["Referrer-Policy"] = "no-referrer"
    sent.headers["Cross-Origin-Opener-Policy"] = "same-origin"
    sent.headers["Cross-Origin-Resource-Policy"] = "same-origin"
    sent.headers["Cache-Control"] = "no-store"
    sent.headers["Connection"] = "close"
    return sent
