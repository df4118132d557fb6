"""Two cameras, or one that sees with both eyes: opened, and read in threads while they are."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Literal, Self

from pseudolidar.errors import CameraUnavailable, UsageError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.capture.address import CameraAddress
from pseudolidar.sources.capture.camera_stream import Asked, CameraStream
from pseudolidar.sources.capture.counts import CaptureCounts
from pseudolidar.sources.capture.grabber import Grabber
from pseudolidar.sources.capture.pair_buffer import PairBuffer
from pseudolidar.sources.capture.shots import ShotPair
from pseudolidar.sources.capture.stamps import (
    ArrivalClock,
    Clock,
    DriverClock,
    Epoch,
    Pace,
    PlayClock,
    StreamClock,
)
from pseudolidar.structures.image_size import ImageSize

# How long the end of a capture waits for the threads of its cameras.
SETTLE_S = 1.0


@dataclass(frozen=True)
class CameraSettings:
    """How cameras are opened and paired.

    Args:
        size: of the pictures that a device is asked for; with both eyes in one, of both.
        rate: pictures a second that a device is asked for.
        pixels: format that a device is asked for: mjpeg, yuyv422, h264.
        tolerance_s: eyes are paired up to this difference; by default a quarter of the interval,
            at most 10 ms.
        clock: what pairs the eyes of pipes and networks: when their pictures arrive, or the times
            in their streams, where both have one clock. Devices have the driver's clock.
        patience_s: a camera that gives no picture for so long ends the run; until then it is
            opened again and again.
        kept: pairs that wait for a worker; more bridge hiccups, and let results lag.
        speed: of videos that are played, times their own.

    Raises:
        UsageError: a number that means nothing.
    """

    size: ImageSize | None = None
    rate: float | None = None
    pixels: str | None = None
    tolerance_s: float | None = None
    clock: Literal["arrival", "stream"] = "arrival"
    patience_s: float = 10.0
    kept: int = 1
    speed: float = 1.0

    def __post_init__(self) -> None:
        numbers = {
            "rate": self.rate,
            "tolerance-s": self.tolerance_s,
            "patience-s": self.patience_s,
            "kept": self.kept,
            "speed": self.speed,
        }
        for name, value in numbers.items():
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise UsageError(f"{value:g}", want="a number above 0", where=f"--camera.{name}")

    @property
    def asked(self) -> Asked:
        """What a device is asked for."""
        size_px = None if self.size is None else (self.size.width, self.size.height)
        return Asked(size_px, self.rate, self.pixels)


@dataclass(frozen=True)
class Cameras:
    """Where pairs are taken.

    Args:
        left: camera of the left eye, or of both: 0, /dev/video0, a pipe, rtsp://..., a video.
        right: camera of the right eye; None where the pictures of `left` hold both.
        realtime: play videos as if live.
        settings: how cameras are opened and paired.
    """

    left: str
    right: str | None = None
    realtime: bool = False
    settings: CameraSettings = field(default_factory=CameraSettings)

    def open(self) -> Capture:
        """Find the cameras and start to read them; `begin` when all is ready for their pairs.

        Raises:
            CameraUnavailable: one is not there.
            UsageError: one is a file that is not to be played, or both are the same.
        """
        addresses: tuple[CameraAddress, ...] = (
            CameraAddress.of(self.left, realtime=self.realtime),
        )
        if self.right is not None:
            addresses = (*addresses, self._right_address(self.right))
        if len({address.kind == "file" for address in addresses}) > 1:
            raise UsageError("a camera and a video", want="two cameras, or two videos")
        if len(set(addresses)) < len(addresses):
            raise UsageError(
                "the same camera for both eyes",
                want="two cameras, or one whose pictures hold both eyes",
                fix="Say how: `live CAM side-by-side OUT`.",
                path=addresses[0].place,
            )
        return Capture(addresses, self.settings)

    def _right_address(self, text: str) -> CameraAddress:
        try:
            return CameraAddress.of(text, realtime=self.realtime)
        except CameraUnavailable as error:
            error.fix += " One camera with both eyes: `live CAM side-by-side OUT`."
            raise


class Capture:
    """Cameras that are read; use it as a context manager.

    Args:
        addresses: of the left and the right camera, or of the one that has both eyes.
        settings: how they are opened and paired.
    """

    def __init__(self, addresses: tuple[CameraAddress, ...], settings: CameraSettings) -> None:
        self.addresses, self.settings = addresses, settings
        self._stop, self._epoch = threading.Event(), Epoch()
        self._pace = Pace(len(addresses), settings.speed, self._stop)
        self._played = all(address.kind == "file" for address in addresses)
        self._buffer = PairBuffer(
            len(addresses),
            tolerance_s=settings.tolerance_s,
            kept=settings.kept,
            patience_s=math.inf if self._played else settings.patience_s,
        )
        self._grabbers = [
            Grabber(eye, self._stream(eye, address), self._buffer)
            for eye, address in enumerate(addresses)
        ]
        self._deadline_s: float | None = None
        for grabber in self._grabbers:
            grabber.start()

    @property
    def counts(self) -> CaptureCounts:
        """What has become of every picture so far."""
        return self._buffer.counts

    @property
    def slipped_s(self) -> float:
        """How far played videos have fallen behind their pace, because decoding is slower."""
        return self._pace.slipped_ns / NS_PER_S

    def seen(self) -> ShotPair:
        """The last picture of each camera, of whatever moment: to see what they give.

        Raises:
            CameraFault, CaptureEnded: there is none.
        """
        return self._buffer.seen()

    def pair_seen(self, within_s: float) -> ShotPair | None:
        """The newest pair of one moment, None where none comes in time; it is not taken."""
        return self._buffer.pair_seen(within_s)

    def begin(self) -> Self:
        """Count from now on; videos, which have shown their first picture, are played."""
        if self._played:
            self._buffer.date_anew(time.monotonic_ns())
            self._pace.begin()
        else:
            self._buffer.forget()
        return self

    def take(self) -> ShotPair:
        """The newest pair that nobody has taken; waits for one. From any thread.

        Raises:
            CaptureEnded: stopped, played to the end, or the time is over.
            CameraFault: a camera gives nothing any more.
            EyesApart: no two pictures are of one moment.
        """
        return self._buffer.take(self._deadline_s)

    def end_after(self, seconds: float) -> None:
        """No pair is given any more when so many seconds have passed from now on."""
        self._deadline_s = time.monotonic() + seconds

    def stop(self) -> None:
        """No pair is given any more; may be called from a signal's handler."""
        self._buffer.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()
        self._stop.set()
        deadline_s = time.monotonic() + SETTLE_S
        for grabber in self._grabbers:
            grabber.join(max(0.0, deadline_s - time.monotonic()))

    def _stream(self, eye: int, address: CameraAddress) -> CameraStream:
        return CameraStream(
            address,
            self.settings.asked,
            clock=self._clock(eye, address),
            damaged=lambda reason: self._buffer.damaged(eye, reason),
            patience_s=self.settings.patience_s,
            stop=self._stop,
        )

    def _clock(self, eye: int, address: CameraAddress) -> Callable[[int], Clock]:
        """What makes the clock of a camera, of the interval between its pictures."""
        if address.kind == "file":
            return lambda interval_ns: PlayClock(self._pace, eye, interval_ns)
        if address.kind == "device":
            return lambda _: DriverClock(self._epoch)
        by_stream = self.settings.clock == "stream"
        return lambda _: (StreamClock if by_stream else ArrivalClock)(self._epoch)
