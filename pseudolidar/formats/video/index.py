"""Which frames a video holds and when they are shown: found from its packets, nothing is decoded.

A packet is one compressed frame; packets stand in order of decoding, which is not that of
presentation where frames are predicted from later ones.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pseudolidar.errors import LimitError, VideoUnreadable
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.video.kind import video_kind
from pseudolidar.structures.arrays import Bool, Int64

# In these containers packets say when they are decoded, and not when they are shown.
DECODING_TIMES_ONLY = ("avi",)
# Bare streams: the times that FFmpeg gives their packets are made up.
BARE_STREAMS = ("mjpeg", "h264", "hevc", "vvc", "m4v", "mpegvideo", "obu", "rawvideo", "dirac")


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """The frames of a video in order of presentation, and where decoding can begin.

    Args:
        container: short name of the container.
        codec: name of the codec.
        size_px: (width, height) as stored.
        time_base: seconds of one tick.
        ticks: (N,) int64, when each frame is shown; increasing.
        packet: (N,) int64, the packet that each frame is in; packets count from 0.
        key_packet: (K,) int64, increasing: packets that decoding can begin at.
        key_frame: (K,) int64, which frame each of them is.
        key_seek: (K,) int64, what to seek for, ticks.
        key_open: (K,) bool, frames shown before the key frame come after it, and need earlier ones.
        counted: frames are told by counting what the decoder gives, not by their times.
        timed: the file says when frames are shown.
        packets: packets that are there.
        promised: packets that the file claims to hold, 0 where it does not say.
        repeated: frames left out because another one has their time.
        leading: frames left out because the file begins behind what they are predicted from.
        cut: why reading ended early, "" where it did not.
    """

    container: str
    codec: str
    size_px: tuple[int, int]
    time_base: Fraction
    ticks: Int64
    packet: Int64
    key_packet: Int64
    key_frame: Int64
    key_seek: Int64
    key_open: Bool
    counted: bool
    timed: bool
    packets: int
    promised: int
    repeated: int
    leading: int
    cut: str

    def __len__(self) -> int:
        return len(self.ticks)

    def timestamps_ns(self) -> tuple[int, ...]:
        """When each frame is shown, exact to half a nanosecond."""
        tick_ns = self.time_base * NS_PER_S
        return tuple(
            round(Fraction(int(ticks) * tick_ns.numerator, tick_ns.denominator))
            for ticks in self.ticks
        )

    def key_of(self, frame: int) -> int:
        """The last key frame that `frame` needs: decoded and shown no later than it."""
        key = int(np.searchsorted(self.key_packet, self.packet[frame], side="right")) - 1
        while key > 0 and self.key_frame[key] > frame:
            key -= 1
        return max(key, 0)

    def start_of(self, frame: int) -> int:
        """The key frame to begin decoding at so that everything `frame` needs is there."""
        key = self.key_of(frame)
        return key - 1 if key and self.key_open[key] else key

    def steps_to(self, frame: int) -> int:
        """Packets to decode for `frame` from there."""
        return int(self.packet[frame] - self.key_packet[self.start_of(frame)])

    def packet_at(self, ticks: int | None) -> int | None:
        """Number of the packet that is shown (or, where frames are counted, decoded) at `ticks`."""
        if ticks is None:
            return None
        at = int(np.searchsorted(self.ticks, ticks))
        known = at < len(self) and self.ticks[at] == ticks
        return int(self.packet[at]) if known else None


def read_index(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> VideoIndex:
    """Read all packets of the first video track of `path`.

    Raises:
        VideoUnreadable: no video, nothing to be seen in it, or its directory is lost.
        LimitError: it claims more pixels a frame than `limits.pixels`.
    """
    import av

    with opened(path) as (container, stream):
        size_px = stream.codec_context.width, stream.codec_context.height
        if size_px[0] * size_px[1] > limits.pixels:
            raise LimitError(
                f"a video that claims {size_px[0]}x{size_px[1]} pixels",
                want=f"at most {limits.pixels} pixels",
                fix=raise_cap("pixels"),
                path=path,
            )
        packets: list[_Packet] = []
        cut = ""
        try:
            for packet in container.demux(stream):
                if packet.size:
                    found = (packet.pts, packet.dts, packet.is_keyframe, packet.is_discard)
                    packets.append(_Packet(*found))
        except av.error.FFmpegError as error:
            cut = str(error.strerror or error)
        if not packets:
            raise VideoUnreadable(
                "a video without a frame", want="frames", fix="Record or copy it again.", path=path
            )
        return _index(container, stream, packets, size_px, cut)


class _Packet(NamedTuple):
    """What a container says of a packet: when it is shown and decoded, ticks."""

    shown: int | None
    decoded: int | None
    is_key: bool
    is_discarded: bool


def _promised(container: str, claimed: int, decoded: Sequence[int | None]) -> int:
    """Packets that the file claims to hold.

    AVI claims moments instead, of which some have no frame; those behind the last frame are its
    duration, as long as another frame would not have been due.
    """
    times = sorted(time for time in decoded if time is not None)
    if container not in DECODING_TIMES_ONLY or not claimed or len(times) < len(decoded):
        return claimed
    interval = max(1, round(float(np.median(np.diff(times))))) if len(times) > 1 else 1
    return len(times) + max(0, claimed - 1 - times[-1]) // interval


def _index(
    container: Any, stream: Any, packets: list[_Packet], size_px: tuple[int, int], cut: str
) -> VideoIndex:
    name = container.format.name.partition(",")[0]
    shown, decoded, keys, discarded = zip(*packets, strict=True)
    reordered = bool(stream.codec_context.has_b_frames)
    bare = name in BARE_STREAMS
    counted = bare or None in shown or (name in DECODING_TIMES_ONLY and reordered)
    timed = not bare and None not in (decoded if counted else shown)
    if counted:
        ticks = np.sort(np.array(decoded if timed else range(len(packets)), np.int64))
        is_key = np.zeros(len(packets), np.bool_) if reordered else np.array(keys, np.bool_)
    else:
        ticks, is_key = np.array(shown, np.int64), np.array(keys, np.bool_)
    is_key[0] = True  # there is nothing before it to begin at
    leading = np.zeros(len(packets), np.bool_) if counted else ticks < ticks[0]
    kept = ~np.array(discarded, np.bool_) & ~leading
    frames = _distinct(ticks, kept)
    key_packet = np.flatnonzero(is_key & np.isin(np.arange(len(packets)), frames))
    if not len(key_packet) or key_packet[0] != 0:
        key_packet = np.concatenate([[0], key_packet]).astype(np.int64)
    by_shown = counted or name == "matroska"  # other containers seek by times of decoding
    seek = [ticks[k] if by_shown or decoded[k] is None else decoded[k] for k in key_packet]
    rate = stream.average_rate or stream.guessed_rate or Fraction(25)
    return VideoIndex(
        container=name,
        codec=stream.codec_context.codec.name,
        size_px=size_px,
        time_base=Fraction(stream.time_base) if timed else 1 / Fraction(rate),
        ticks=ticks[frames],
        packet=frames,
        key_packet=key_packet,
        key_frame=np.searchsorted(ticks[frames], ticks[key_packet]).astype(np.int64),
        key_seek=np.array(seek, np.int64),
        key_open=_open_keys(ticks, key_packet),
        counted=counted,
        timed=timed,
        packets=len(packets),
        promised=_promised(name, int(stream.frames), decoded),
        repeated=int(np.count_nonzero(kept)) - len(frames),
        leading=int(np.count_nonzero(leading)),
        cut=cut,
    )


def _distinct(ticks: Int64, kept: Bool) -> Int64:
    """Packets in order of presentation; of those of one time the first."""
    order = np.flatnonzero(kept)[np.argsort(ticks[kept], kind="stable")]
    first = np.ones(len(order), np.bool_)
    first[1:] = ticks[order][1:] != ticks[order][:-1]
    return order[first].astype(np.int64)


def _open_keys(ticks: Int64, key_packet: Int64) -> Bool:
    """For each key, whether a packet up to the next one is shown before it."""
    ends = np.append(key_packet[1:], len(ticks))
    return np.array(
        [
            bool((ticks[begin:end] < ticks[begin]).any())
            for begin, end in zip(key_packet, ends, strict=True)
        ],
        np.bool_,
    )


@contextlib.contextmanager
def opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """As `open_video`, closed at the end."""
    container, stream = open_video(path)
    with container:
        yield container, stream


def open_video(path: Path) -> tuple[Any, Any]:
    """The container at `path` and its first track of moving pictures.

    Raises:
        VideoUnreadable: it cannot be opened, or has no such track.
    """
    import av

    quiet_libav()
    try:
        container = av.open(str(path), metadata_errors="replace")
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise _unreadable(path, error) from error
    for stream in container.streams.video:
        still = stream.disposition & av.stream.Disposition.attached_pic
        if stream.codec_context is not None and not still:
            return container, stream
    kinds = sorted({stream.type for stream in container.streams})
    container.close()
    raise VideoUnreadable(
        f"no track of pictures that can be decoded, only {', '.join(kinds) or 'nothing'}",
        want="a video",
        path=path,
    )


def quiet_libav() -> None:
    """Let the decoders' complaints be asked for, and keep them off the terminal."""
    import av

    if av.logging.get_level() != av.logging.ERROR:
        logger = logging.getLogger("libav")
        logger.addHandler(logging.NullHandler())
        logger.propagate = False
        av.logging.set_skip_repeated(False)
        av.logging.set_level(av.logging.ERROR)


def _unreadable(path: Path, error: Exception) -> VideoUnreadable:
    if not path.exists():
        return VideoUnreadable("no such file", want="a video", fix="Check the path.", path=path)
    kind = video_kind(path)
    reason = getattr(error, "strerror", None) or str(error)
    if kind == "MP4" and b"moov" not in _box_names(path):
        return VideoUnreadable(
            "an MP4 without its directory (moov): the recording was cut off before its end",
            want="a whole file",
            fix="Copy it again, or record to MKV, which is readable up to where it was cut.",
            path=path,
        )
    return VideoUnreadable(
        f"{kind or 'no known video'}: {reason}", want="a whole video file", path=path
    )


def _box_names(path: Path) -> list[bytes]:
    """Names of the top-level boxes of an MP4, as far as they go."""
    names, place, size = [], 0, path.stat().st_size
    with path.open("rb") as file:
        while place + 8 <= size:
            file.seek(place)
            head = file.read(16)
            names.append(head[4:8])
            length = int.from_bytes(head[:4], "big")
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            if length < 8:
                break
            place += length
    return names
