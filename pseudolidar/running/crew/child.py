"""What a worker process runs: frames by their index, until its parent is gone."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import pickle
import signal
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from pseudolidar.running.crew.attempt import attempt
from pseudolidar.running.crew.parcels import SharedArea, packed
from pseudolidar.running.memory import keep_freed_memory

# Messages of a child that are no outcome.
READY, LOADED, FAILED = b"ready", b"loaded", b"failed "
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_MOST_WILLING = "1000"  # of what /proc/PID/oom_score_adj takes
_BYTES_PER_MB = 1_000_000
_STATUS = Path("/proc/self/status")


def main(channel: int, area: int, parent: int) -> None:
    """Do frames as the parent asks for them.

    Args:
        channel: descriptor of the connection with the parent.
        area: descriptor of the memory shared with it.
        parent: its process id.
    """
    _end_with(parent)
    faulthandler.enable(all_threads=False)
    with Connection(channel) as connection:
        try:
            source, per_frame, memory_limit_mb = pickle.loads(connection.recv_bytes())
            _set_up(memory_limit_mb)
        except Exception as error:  # told to the parent, who ends the run with it
            connection.send_bytes(FAILED + f"{type(error).__name__}: {error}".encode())
            return
        connection.send_bytes(READY)
        _serve(connection, SharedArea(area), source, per_frame)


def _serve(
    connection: Connection, area: SharedArea, source: Any, per_frame: Callable[[Any], Any]
) -> None:
    def noted(frame: Any) -> Any:
        connection.send_bytes(LOADED)
        return per_frame(frame)

    while True:
        try:
            index = connection.recv()
        except EOFError:
            return
        outcome = attempt(source, noted, index)
        connection.send_bytes(packed(outcome, area))
        del outcome  # else its bytes would live while the next frame is done


def _end_with(parent: int) -> None:
    """Die when the parent does, however it dies; and before it, where memory runs out.

    Elsewhere than on Linux a child whose parent was killed ends after its frame.
    """
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it died before it could be told
        os._exit(1)
    try:
        Path("/proc/self/oom_score_adj").write_text(_MOST_WILLING)
    except OSError:
        return  # the kernel then chooses as it likes


def _set_up(memory_limit_mb: float | None) -> None:
    import cv2

    cv2.setNumThreads(1)
    keep_freed_memory()
    if memory_limit_mb is not None:
        _limit_memory(round(memory_limit_mb * _BYTES_PER_MB))


def _limit_memory(limit: int) -> None:
    """Bound private, writable memory: what arrays are made of.

    Files that are mapped, and the results that the parent takes over, do not count.

    Raises:
        ValueError: the process holds more already.
    """
    import resource

    if _STATUS.exists():
        held = next(line for line in _STATUS.read_text().splitlines() if "VmData" in line)
        held_bytes = int(held.split()[1]) * 1024
        if limit < held_bytes:
            raise ValueError(
                f"a limit of {limit // _BYTES_PER_MB} MB, and {held_bytes // _BYTES_PER_MB} MB are "
                "taken before the first frame"
            )
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
