"""Where to listen: this machine alone, unless somebody says otherwise."""

from __future__ import annotations

import errno
import socket
from dataclasses import dataclass
from typing import Self

from pseudolidar.errors import ServeError, UsageError
from pseudolidar.viewer.port_owner import port_owner

LOOPBACK = "127.0.0.1"
# What `--port` says for any port that is free, and the highest port that there is.
ANY_PORT, LAST_PORT = "auto", 65535
# Connections that may wait to be taken.
BACKLOG = 64


class Port(int):
    """A port to listen at: 1 to 65535, or 0 for any that is free."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """From text: a number such as `8080`, or `auto`, which is 0.

        Raises:
            UsageError: there is no such port.
        """
        number = "0" if text.strip().lower() == ANY_PORT else text.strip()
        # int() would take other digits than ours, and more of them than anybody reads.
        plain = number.isascii() and number.isdigit() and len(number) <= len(str(LAST_PORT))
        if not plain or int(number) > LAST_PORT:
            raise UsageError(
                f"{text!r}", want=f"0 to {LAST_PORT}; 0 or {ANY_PORT} is any port that is free"
            )
        return cls(number)


PORT = Port(8080)


@dataclass(frozen=True)
class Address:
    """Where to serve.

    Args:
        host: to bind to; others than loopback let other machines in, who still need the token.
        port: 1 to 65535, or 0 for any that is free.
        names: what this machine is called by those who come from others.
    """

    host: str = LOOPBACK
    port: int = PORT
    names: tuple[str, ...] = ()

    @property
    def loopback(self) -> bool:
        """Whether only this machine can come."""
        return self.host in (LOOPBACK, "::1", "localhost")

    def bound(self) -> socket.socket:
        """A socket that listens there.

        Raises:
            ServeError: the port is taken, or the host is none of this machine.
        """
        where = f"{self.host}:{self.port}"
        try:
            family, _, _, _, place = socket.getaddrinfo(
                # getaddrinfo refuses subclasses of int.
                self.host,
                int(self.port),
                type=socket.SOCK_STREAM,
                flags=socket.AI_PASSIVE,
            )[0]
            listening = socket.socket(family, socket.SOCK_STREAM)
        except OSError as error:
            raise ServeError(f"host {self.host}: {error.strerror or error}", where=where) from None
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(place)
            listening.listen(BACKLOG)
        except OSError as error:
            listening.close()
            taken = error.errno == errno.EADDRINUSE
            raise ServeError(
                _in_use(self.port) if taken else f"cannot listen there: {error.strerror}",
                want="a free port" if taken else "an address of this machine",
                where=where,
            ) from None
        return listening


def _in_use(port: int) -> str:
    owner = port_owner(port)
    return "the port is in use" if owner is None else f"the port is in use by {owner}"
