"""A decoder at a place of a video: it goes forward, or begins anew at a key frame."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.errors import VideoDamaged
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.video.index import VideoIndex, open_video

if TYPE_CHECKING:
    from av import VideoFrame

# Complaints that are no damage: a frame that is to be forgotten is not there, as happens to H.264
# after seeking to a key frame with frames before it that need earlier ones.
HARMLESS = ("mmco: unref short failure",)
# What seeking costs more than going on, in packets.
SEEK_PACKETS = 4
# A frame that was passed so few frames ago is still kept for those who ask a little later.
PASSED_KEPT = 4


class VideoCursor:
    """One decoder and its place in the file; whoever uses it holds `lock`.

    Args:
        path: the file.
        index: its frames.
        limits: cap on the pixels that its stream may claim.
    """

    def __init__(self, path: Path, index: VideoIndex, limits: Limits) -> None:
        self.lock = threading.Lock()
        self.aim = -1  # the frame that it was last sent to
        self.packets_decoded = 0
        self._path, self._index, self._limits = path, index, limits
        self._container: Any = None
        self._packets: Iterator[Any] = iter(())
        self._frames: Iterator[VideoFrame] = iter(())
        self._next = 0  # number of the packet that comes next
        self._emitted = -1  # last frame that the decoder gave
        self._begun_at, self._begun_packet = 0, 0  # the first frame that may be trusted
        self._faults: list[tuple[int, str]] = []  # packets that did not decode whole
        self._live = False

    def distance(self, number: int) -> float:
        """Packets to decode until the frame, going on from where the cursor is being sent to."""
        if self.aim < 0 or not self._live:
            return np.inf
        packet = self._index.packet
        if self.aim < number:
            return float(max(0, packet[number] - packet[self.aim]))
        passing = self.lock.locked() and number > self.aim - PASSED_KEPT
        return 0.0 if passing else np.inf

    def bring(
        self, number: int, keep: Callable[[int, VideoFrame | VideoDamaged], None]
    ) -> VideoFrame | VideoDamaged:
        """Decode until frame `number`; every frame on the way is handed to `keep`, and it too."""
        if not self._reaches(number):
            self._begin_before(number)
        while (frame := next(self._frames, None)) is not None:
            passed = self._number_of(frame)
            if passed is None or passed <= self._emitted:  # not to be trusted, or there already
                continue
            if passed > number:  # it was left out
                break
            if self._is_spoilt(passed):
                self._begin_before(number)
                continue
            self._emitted = passed
            verdict = self._verdict(passed, frame)
            keep(passed, verdict)
            if passed == number:
                return verdict
        self._live = False
        nothing = self.damaged(number, self._reason(number) or "the decoder gives no picture")
        keep(number, nothing)
        return nothing

    def damaged(self, number: int, reason: str) -> VideoDamaged:
        """The error of a frame that is not whole."""
        return VideoDamaged(
            reason,
            want="a whole frame, and whole ones that it is predicted from",
            fix="Copy the file again; frames that can be decoded are used.",
            path=self._path,
            where=f"frame {number}",
        )

    def _reaches(self, number: int) -> bool:
        """Whether going on is possible and no more work than seeking."""
        if not self._live or number <= self._emitted or number < self._begun_at:
            return False
        forward = int(self._index.packet[number]) - self._next
        near = forward <= self._index.steps_to(number) + SEEK_PACKETS
        return near and not self._is_spoilt(number)

    def _is_spoilt(self, number: int) -> bool:
        """Whether something before the key frame of `number` was damaged.

        A decoder that has met damage may carry it over a key frame (measured: H.264, CAVLC, after
        a damaged intra frame, even when flushed): what follows is left to a new one.
        """
        needed = int(self._index.key_packet[self._index.key_of(number)])
        return any(self._begun_packet <= packet < needed for packet, _ in self._faults)

    def _begin_before(self, number: int) -> None:
        index = self._index
        key, start = index.key_of(number), index.start_of(number)
        self._begun_at, self._begun_packet = int(index.key_frame[key]), int(index.key_packet[key])
        self._emitted = self._begun_at - 1
        if self._container is None or self._faults:
            self._open()
        self._faults = []
        if not (start and index.timed and self._sought(start)):
            self._rewind(int(index.key_packet[start]))
        self._frames = self._decoded_frames()
        self._live = True

    def _sought(self, key: int) -> bool:
        """Seek to a key frame; False where the container does not lead there."""
        import av

        index = self._index
        wanted = int(index.key_packet[key])
        try:
            self._container.seek(int(index.key_seek[key]), stream=self._stream, backward=True)
            packets = (packet for packet in self._container.demux(self._stream))
            for packet in packets:
                number = index.packet_at(packet.dts if index.counted else packet.pts)
                if not packet.size or (number is not None and number > wanted):
                    return False
                if number == wanted:
                    self._packets = _chained(packet, packets)
                    self._next = wanted
                    return True
        except av.error.FFmpegError:
            pass
        return False

    def _rewind(self, packet: int) -> None:
        """Open the file again and pass over all packets before `packet`."""
        self._open()
        self._packets = (p for p in self._container.demux(self._stream) if p.size)
        self._next = 0
        while self._next < packet and next(self._packets, None) is not None:
            self._next += 1

    def _open(self) -> None:
        if self._container is not None:
            self._container.close()
        self._container, self._stream = open_video(self._path)
        context = self._stream.codec_context
        # The frames of a run are spread over the cores already. A single thread also complains
        # about a packet when it is given that packet, and not some packets later.
        context.thread_type, context.thread_count = "NONE", 1
        context.options = {
            "err_detect": "crccheck+bitstream+buffer",
            "max_pixels": str(self._limits.pixels),
        }

    def _decoded_frames(self) -> Iterator[VideoFrame]:
        """What the decoder gives for the packets that come next."""
        context = self._stream.codec_context
        for packet in self._packets_left():
            if packet is not None:
                if packet.is_corrupt:
                    self._faults.append((self._next, "a damaged packet"))
                if self._is_lost_leading(packet):
                    self._next += 1
                    continue
            yield from self._given(context, packet)
            self._next += packet is not None

    def _packets_left(self) -> Iterator[Any]:
        """The packets that come next, and None at the end."""
        import av

        try:
            yield from (packet for packet in self._packets if packet.size)
        except av.error.FFmpegError as error:
            self._faults.append((self._next, f"reading ends here: {error.strerror}"))
        yield None

    def _given(self, context: Any, packet: Any) -> list[VideoFrame]:
        import av

        frames: list[VideoFrame] = []
        self.packets_decoded += packet is not None
        with av.logging.Capture() as complaints:
            try:
                frames = context.decode(packet)
            except av.error.FFmpegError as error:
                self._faults.append((self._next, error.strerror or str(error)))
        self._faults += [
            (self._next, text.strip())
            for level, _, text in complaints
            if level <= av.logging.ERROR and not text.startswith(HARMLESS)
        ]
        return frames

    def _is_lost_leading(self, packet: Any) -> bool:
        """Whether a packet is shown before the first key frame: what it needs is not there."""
        index = self._index
        return bool(not index.counted and index.leading and packet.pts < index.ticks[0])

    def _number_of(self, frame: VideoFrame) -> int | None:
        index = self._index
        if index.counted:
            return self._emitted + 1
        if frame.pts is None:
            return None
        at = int(np.searchsorted(index.ticks, frame.pts))
        return at if at < len(index) and index.ticks[at] == frame.pts else None

    def _verdict(self, number: int, frame: VideoFrame) -> VideoFrame | VideoDamaged:
        """The frame, unless it or one before it since the last key frame is damaged."""
        if frame.is_corrupt:
            self._faults.append(
                (int(self._index.packet[number]), "the decoder marks it as corrupt")
            )
        reason = self._reason(number)
        return frame if reason is None else self.damaged(number, reason)

    def _reason(self, number: int) -> str | None:
        """Why a frame is not whole: a fault in its packet or between that and its key frame."""
        own = int(self._index.packet[number])
        needed = int(self._index.key_packet[self._index.key_of(number)])
        return next((text for packet, text in self._faults if needed <= packet <= own), None)


def _chained(first: Any, others: Iterator[Any]) -> Iterator[Any]:
    yield first
    yield from others
