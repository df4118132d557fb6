"""One camera: opened, read, and opened again; devices, pipes, networks and videos alike.

PyAV reads them all, so that a test with a video runs the code that reads a camera. Of a device it
hands over the packets of the driver with their time stamps: a JPEG that arrived by half can be told
and left out. `cv2.VideoCapture` decodes it, invents the lower half and says nothing.
"""

from __future__ import annotations

import contextlib
import errno
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from pseudolidar.errors import (
    CameraChanged,
    CameraFault,
    CameraLost,
    CameraStalled,
    CameraUnavailable,
)
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.video.index import BARE_STREAMS, open_video, quiet_libav
from pseudolidar.formats.video.packets import WholeFrames
from pseudolidar.sources.capture.address import CameraAddress
from pseudolidar.sources.capture.pipe import PipeReader
from pseudolidar.sources.capture.shots import Shot
from pseudolidar.sources.capture.stamps import Clock

V4L2 = "v4l2"
# What libav may read of a stream before it says what is in it: its default is 5 s of live pictures.
PROBED_BYTES, PROBED_US = 1_000_000, 500_000
# What to do about a pipe or a network address.
SENDER = "Check what sends it, then run the same command again: it adds to what is there."
# Dated by libav's guess of 25 pictures a second where a video says nothing.
GUESSED_RATE = Fraction(25)


@dataclass(frozen=True)
class Asked:
    """What a device is asked for; streams and videos are what they are.

    Args:
        size_px: (width, height).
        rate_hz: pictures a second.
        pixels: format of the driver: mjpeg, yuyv422, h264.
    """

    size_px: tuple[int, int] | None = None
    rate_hz: float | None = None
    pixels: str | None = None

    @property
    def options(self) -> dict[str, str]:
        """As libav's v4l2 takes them."""
        size = {} if self.size_px is None else {"video_size": "{}x{}".format(*self.size_px)}
        rate = {} if self.rate_hz is None else {"framerate": f"{self.rate_hz:g}"}
        pixels = {} if self.pixels is None else {"input_format": self.pixels}
        return {**size, **rate, **pixels}


@dataclass(eq=False)
class CameraStream:
    """The pictures of one camera.

    Args:
        address: where it is.
        asked: what a device is asked for.
        clock: makes the clock that its pictures are stamped by, of the interval between them, ns.
        damaged: told of each picture that is not whole.
        patience_s: longest wait for a network or a pipe.
        stop: set when nobody wants more pictures.
    """

    address: CameraAddress
    asked: Asked
    clock: Callable[[int], Clock]
    damaged: Callable[[str], None]
    patience_s: float
    stop: threading.Event
    _clock: Clock | None = field(default=None, init=False)
    _size_px: tuple[int, int] | None = field(default=None, init=False)

    def shots(self) -> Iterator[Shot]:
        """Open the camera and yield its pictures until it ends; may be called again then.

        Raises:
            CameraUnavailable: it cannot be opened.
            CameraLost: reading fails.
            CameraStalled: nothing comes.
            CameraChanged: a picture has another size than the first one of all.
            VideoUnreadable: a video that is none.
        """
        with self._opened() as track:
            clock = self._clock = self._clock or self.clock(_interval_ns(track))
            clock.begin()
            try:
                yield from self._stamped(track, clock)
            finally:
                clock.end()

    def _stamped(self, track: Any, clock: Clock) -> Iterator[Shot]:
        decoder = WholeFrames(track, self.damaged)
        tick_ns = Fraction(track.time_base or 0) * NS_PER_S
        dated = _is_dated(track)
        for packet in self._packets(track):
            for frame in decoder.decode(packet):
                ticks = (packet.dts if frame.pts is None else frame.pts) if dated else None
                stamp = clock.stamp(None if ticks is None else round(ticks * tick_ns))
                if self.stop.is_set():
                    return
                self._check_size(frame)
                yield Shot(frame, stamp)

    def _packets(self, track: Any) -> Iterator[Any]:
        import av

        try:
            yield from track.container.demux(track)
        except (av.error.FFmpegError, OSError) as error:
            raise self._lost(error) from error

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Any]:
        """The track of pictures of the open camera."""
        if self.address.kind == "file":
            container, track = open_video(Path(self.address.place))
            with container:
                yield track
            return
        import av

        quiet_libav()
        with contextlib.ExitStack() as opened:
            try:
                container = opened.enter_context(self._container(opened))
                track = next(iter(container.streams.video), None)
            except (av.error.FFmpegError, OSError, ValueError) as error:
                raise self._unavailable(error) from error
            if track is None or track.codec_context is None:
                raise CameraUnavailable(
                    "no pictures in it", want="a track of pictures", path=self.address.place
                )
            yield track

    def _container(self, opened: contextlib.ExitStack) -> Any:
        import av

        place, kind = self.address.place, self.address.kind
        if kind == "device":
            return av.open(place, format=V4L2, container_options=self.asked.options)
        quick = {
            "probesize": str(PROBED_BYTES),
            "analyzeduration": str(PROBED_US),
            "fpsprobesize": "0",  # the rate is measured as pictures come
        }
        if kind == "pipe":
            pipe = opened.enter_context(PipeReader(place, self.patience_s, self.stop))
            return av.open(pipe, container_options=quick)
        wait_s = (self.patience_s, self.patience_s)
        return av.open(place, container_options=quick, timeout=wait_s)

    def _check_size(self, frame: Any) -> None:
        size_px = frame.width, frame.height
        self._size_px = self._size_px or size_px
        if size_px != self._size_px:
            raise CameraChanged(
                "pictures of {}x{}".format(*size_px),
                want="{}x{}, as before".format(*self._size_px),
                path=self.address.place,
            )

    def _unavailable(self, error: Exception) -> CameraFault:
        number, place = getattr(error, "errno", 0) or 0, self.address.place
        fixes = {
            errno.EBUSY: "Another program has it: `fuser -v " + place + "` tells which.",
            errno.EACCES: "Become a member of the group `video`, and log in again.",
            errno.ENOTTY: "Give the device of a camera: v4l2-ctl --list-devices.",
            errno.EINVAL: "Ask for a size, a rate and a format that it has: "
            f"v4l2-ctl --list-formats-ext -d {place}.",
        }
        return CameraUnavailable(
            getattr(error, "strerror", None) or str(error),
            want="a camera that can be opened",
            fix=fixes.get(number, "") if self.address.kind == "device" else SENDER,
            path=place,
        )

    def _lost(self, error: Exception) -> CameraFault:
        import av

        reason = getattr(error, "strerror", None) or str(error)
        fix = "" if self.address.kind == "device" else SENDER
        if isinstance(error, av.error.ExitError | TimeoutError):
            return CameraStalled(
                f"nothing came for {self.patience_s:g} s",
                want="a stream that goes on",
                fix=fix,
                path=self.address.place,
            )
        return CameraLost(reason, want="a camera that stays", fix=fix, path=self.address.place)


def _is_dated(track: Any) -> bool:
    """Whether the times of a track are more than libav's guess."""
    return track.container.format.name.partition(",")[0] not in BARE_STREAMS


def _interval_ns(track: Any) -> int:
    rate = track.average_rate or track.guessed_rate or GUESSED_RATE
    return round(NS_PER_S / Fraction(rate))
