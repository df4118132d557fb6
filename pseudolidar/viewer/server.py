"""viser behind a guard: at an address of our choice, silent, and asked only what we allow."""

from __future__ import annotations

import atexit
import contextlib
import io
import socket
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pseudolidar.errors import MissingDependency, ServeError
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.answers import Page
from pseudolidar.viewer.gate import Gate
from pseudolidar.viewer.guard import Guard

if TYPE_CHECKING:
    from viser import ViserServer

# The guard sits at a place of viser that is no promise of its makers.
GUARDED_VERSION = "1.1.1"


@dataclass
class GuardedServer:
    """A viser server that was started under a guard.

    Args:
        viser: scene and controls.
        guard: judges who comes.
        url: to print: with the token.
        pages: our own pages by path, added to at any time.
    """

    viser: ViserServer
    guard: Guard
    url: str
    pages: dict[str, Page] = field(default_factory=dict)

    def stop(self) -> None:
        """Close every connection, and say nothing about it."""
        atexit.unregister(self.stop)
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


def serve(address: Address, *, label: str) -> GuardedServer:
    """Start viser at an address, with nothing on the terminal.

    Raises:
        ServeError: the address cannot be had, or viser is of a version that was not tried.
        MissingDependency: viser is absent.
    """
    viser = _viser()
    listening = address.bound()
    port = int(listening.getsockname()[1])
    pages: dict[str, Page] = {}
    spoken = f"viser-v{GUARDED_VERSION}"
    gate = Gate(Guard(port, names=_names(address)), pages, spoken)
    try:
        with gate.in_place(listening), contextlib.redirect_stdout(io.StringIO()):
            started = viser.ViserServer(host=address.host, port=port, label=label, verbose=False)
    except BaseException:
        listening.close()
        raise
    gate.opened(started)
    host = f"[{address.host}]" if ":" in address.host else address.host
    url = f"http://{_shown(address, host)}:{port}/?token={gate.guard.token}"
    server = GuardedServer(started, gate.guard, url, pages)
    # viser's own farewell is printed.
    atexit.unregister(started.stop)
    atexit.register(server.stop)
    return server


def _viser() -> Any:
    try:
        import viser
    except ImportError as error:
        raise MissingDependency(f"viser: {error}", want="the package viser") from None
    if viser.__version__ != GUARDED_VERSION:
        raise ServeError(
            f"viser {viser.__version__}",
            want=f"viser {GUARDED_VERSION}, for which the guard was tried",
            fix=f"pip install viser=={GUARDED_VERSION}",
        )
    return viser


def _names(address: Address) -> tuple[str, ...]:
    if address.loopback:
        return address.names
    return (*address.names, address.host, socket.gethostname())


def _shown(address: Address, host: str) -> str:
    everywhere = address.host in ("", "0.0.0.0", "::")
    return (address.names or (socket.gethostname(),))[0] if everywhere else host
