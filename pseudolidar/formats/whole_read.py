"""Whole files as bytes, of one moment: a file that changes meanwhile is read again, once."""

from __future__ import annotations

import os
from pathlib import Path

from pseudolidar.errors import InputChanged

TRIES = 2


def read_whole(path: Path) -> bytes:
    """All bytes of a file that nobody wrote to while it was read.

    Raises:
        OSError: it cannot be read.
        InputChanged: its size or time changed during each of two readings.
    """
    for _ in range(TRIES):
        before = _state(path)
        data = path.read_bytes()
        if _state(path) == before:
            return data
    raise InputChanged(
        f"the file changed while it was read, {TRIES} times",
        want="a file that nobody is writing to",
        fix="Wait until it is complete, and run the same command again.",
        path=path,
    )


def _state(path: Path) -> tuple[int, ...]:
    found: os.stat_result = path.stat()
    return found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns
