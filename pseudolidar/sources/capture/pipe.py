"""A named pipe as a file that libav reads: no wait is endless, and none outlives the capture."""

from __future__ import annotations

import os
import select
import threading
import time
from types import TracebackType
from typing import Self

from pseudolidar.errors import CameraStalled, CameraUnavailable

# How often a reader that waits looks whether it is still wanted.
LOOK_MS = 100


class PipeReader:
    """Reads a named pipe; at the end of its writer it is at its end.

    Opening a pipe waits for a writer, and no signal ends that wait inside a library: so it is
    opened without waiting, and waited for here.

    Args:
        path: the pipe.
        patience_s: longest wait for a byte.
        stop: set when nobody wants to read any more.

    Raises:
        CameraUnavailable: it cannot be opened.
    """

    def __init__(self, path: str, patience_s: float, stop: threading.Event) -> None:
        self._path, self._patience_s, self._stop = path, patience_s, stop
        try:
            self._descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise CameraUnavailable(
                error.strerror or str(error), want="a pipe that can be read", path=path
            ) from error

    def read(self, most: int) -> bytes:
        """Up to `most` bytes as soon as there are some; none at the end.

        Raises:
            CameraStalled: nobody has written for too long.
        """
        deadline_s = time.monotonic() + self._patience_s
        ready = select.poll()
        ready.register(self._descriptor, select.POLLIN)
        while not self._stop.is_set():
            events = [event for _, event in ready.poll(LOOK_MS)]
            if events:
                return os.read(self._descriptor, most)  # nothing where the writer is gone
            if time.monotonic() > deadline_s:
                raise CameraStalled(
                    f"nobody has written to the pipe for {self._patience_s:g} s",
                    want="a program that writes a video to it",
                    fix="Start that program, or wait longer with --camera.patience-s.",
                    path=self._path,
                )
        return b""

    def close(self) -> None:
        """Let go of the pipe; its writer is told when it writes on."""
        os.close(self._descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
