"""Which frames are being done, in a file that outlives a crash: the next run can tell."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path

from pseudolidar.errors import printable
from pseudolidar.formats.atomic import output_error

IN_FLIGHT_NAME = ".in_flight"
_log = logging.getLogger(__name__)


class InFlight:
    """Notes frames while they are done; use `noting`.

    A note reaches the system, not the disk: it survives the process, and power cuts are nobody's
    frame's fault.

    Args:
        descriptor: of the file, empty.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._names: list[str] = []
        self._written = 0
        self._changing = threading.Lock()

    @contextlib.contextmanager
    def noted(self, name: str) -> Iterator[None]:
        """Block in which a frame is done."""
        with self._changing:
            self._names.append(name)
            self._write()
        try:
            yield
        finally:
            with self._changing:
                self._names.remove(name)
                self._write()

    def _write(self) -> None:
        # One call, padded over what was there: whenever the process dies, the file is whole.
        text = json.dumps(self._names).encode()
        with contextlib.suppress(OSError):  # a full disk stops the run elsewhere, with its reason
            os.pwrite(self._descriptor, text.ljust(self._written), 0)
        self._written = max(self._written, len(text))


@contextlib.contextmanager
def noting(folder: Path) -> Iterator[InFlight]:
    """Note frames in `folder`, owned by this run; first tell what a run that died has left there.

    Raises:
        OutputError: the folder cannot be written to.
    """
    path = folder / IN_FLIGHT_NAME
    names = left_by_the_last_run(path)
    if names:
        _log.warning(
            "the last run here died while it did %s %s; should it die again, --isolate does each "
            "frame in a process of its own and leaves out those that crash",
            "frames" if len(names) > 1 else "frame",
            printable(", ".join(names)),
        )
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise output_error(path, error) from error
    try:
        yield InFlight(descriptor)
    finally:
        os.close(descriptor)
        path.unlink(missing_ok=True)


def left_by_the_last_run(path: Path) -> tuple[str, ...]:
    """Frames that a dead run was doing; none where it ended in order, or left something else."""
    try:
        names = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return ()
    return tuple(map(str, names)) if isinstance(names, list) else ()
