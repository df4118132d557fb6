"""The thread of one camera: it hands over every picture at once, and comes back after faults."""

from __future__ import annotations

import logging
import threading

from pseudolidar.errors import CameraLost, CameraUnavailable, PseudolidarError, printable
from pseudolidar.sources.capture.camera_stream import CameraStream
from pseudolidar.sources.capture.pair_buffer import PairBuffer

_log = logging.getLogger(__name__)
# How long a camera that is gone is left alone before it is tried again.
RETRY_S = 0.5


class Grabber:
    """Reads a camera in a thread of its own until it is stopped.

    Args:
        eye: 0 left (or both in one), 1 right.
        camera: what to read.
        buffer: where the pictures go.
        retry_s: pause before a camera that is gone is tried again.
    """

    def __init__(
        self, eye: int, camera: CameraStream, buffer: PairBuffer, *, retry_s: float = RETRY_S
    ) -> None:
        self._eye, self._camera, self._buffer, self._retry_s = eye, camera, buffer, retry_s
        self._shots, self._fault = 0, ""
        # A daemon: a driver may hold it for ever, and must not hold the end of the program too.
        self._thread = threading.Thread(target=self._run, name=f"camera-{eye}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def join(self, timeout_s: float) -> None:
        """Wait for the thread, which ends with its camera's next picture once it was stopped."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            while not self._camera.stop.is_set():
                if not self._once():
                    return
                self._camera.stop.wait(self._retry_s)
        except BaseException as error:  # handed to whoever waits for a pair
            self._buffer.fail(error)

    def _once(self) -> bool:
        """Read the camera until something ends it; whether to try again."""
        fault: PseudolidarError
        try:
            for shot in self._camera.shots():
                if self._fault:
                    self._came_back()
                self._shots += 1
                self._buffer.put(self._eye, shot)
            fault = CameraLost("its stream has ended", want="a camera that stays")
        except PseudolidarError as error:
            fault = error
        else:
            if not self._camera.address.reopens:
                self._buffer.ended(self._eye)
                return False
        if self._camera.stop.is_set():
            return False
        hopeless = not self._camera.address.reopens or (
            not self._shots and isinstance(fault, CameraUnavailable)
        )
        if hopeless:
            raise fault
        self._gone(fault.located(self._camera.address.place))
        return True

    def _gone(self, fault: PseudolidarError) -> None:
        if fault.got != self._fault:  # else it was told
            _log.warning("%s; trying again", printable(str(fault)))
        self._fault = fault.got
        self._buffer.failed(self._eye, fault)

    def _came_back(self) -> None:
        _log.warning("%s is back", printable(self._camera.address.place))
        self._fault = ""
        self._buffer.reopened(self._eye)
