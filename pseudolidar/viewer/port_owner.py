"""Which process listens at a port of this machine, as Linux tells it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

PROC = Path("/proc")
TABLES = ("net/tcp", "net/tcp6")
# State of a socket that listens, as the kernel writes it: include/net/tcp_states.h.
LISTENS = "0A"
# Of a command, so that an error stays one line.
LONGEST_COMMAND = 60


def port_owner(port: int) -> str | None:
    """The process that listens at a port, as `python view.py (process 1234)`.

    None where that cannot be found: another system, or the process of another user.
    """
    sockets = set(_listening(port))
    for folder in PROC.glob("[0-9]*") if sockets else ():
        if not sockets.isdisjoint(_sockets_of(folder)):
            return f"{command_of(folder)} (process {folder.name})"
    return None


def _listening(port: int) -> Iterator[str]:
    """What the sockets at a port are called among the files of a process."""
    for table in TABLES:
        try:
            _, *rows = (PROC / table).read_text().splitlines()
        except (OSError, ValueError):
            continue
        for fields in (row.split() for row in rows):
            _, _, at = fields[1].rpartition(":")
            if int(at, 16) == port and fields[3] == LISTENS:
                yield f"socket:[{fields[9]}]"


def _sockets_of(process: Path) -> Iterator[str]:
    try:
        for link in (process / "fd").iterdir():
            yield str(link.readlink())
    except OSError:  # another user's, or ended meanwhile
        return


def command_of(process: Path) -> str:
    """The command line of a process, cut where it is long.

    Args:
        process: its folder below `/proc`.
    """
    try:
        words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return "a process"
    # Program and script without their folders: there is room then for what it was asked to do.
    said = " ".join([*(Path(word).name for word in words[:2]), *words[2:]]).strip()
    return said if len(said) <= LONGEST_COMMAND else f"{said[:LONGEST_COMMAND]}..."
