"""MP4 that browsers play: H.264, the index in front, the same bytes for the same pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import MissingDependency, StructureError
from pseudolidar.formats.atomic import atomic_file
from pseudolidar.structures.arrays import UInt8

# Ticks of a second, as MPEG counts them.
TICKS_PER_S = 90_000
# Encoders by preference, with their settings; all but the last make H.264, which browsers play.
# x264's "mbtree" reads, with AVX-512, what memory happens to hold below a picture whose height is
# no multiple of 16: 1 film in 70 was of other bytes (docs/decisions.md).
ENCODERS: dict[str, dict[str, str]] = {
    "libx264": {"preset": "veryfast", "crf": "22", "mbtree": "0"},
    "libopenh264": {"rc_mode": "quality"},
    "mpeg4": {"qscale": "4"},
}
# Frames from one key frame to the next: what seeking in a browser costs.
KEY_EVERY = 50
# Length of the head of a box, and of one whose length does not fit into 32 bits.
BOX_BYTES, LARGE_BOX_BYTES = 8, 16


def mp4_encoder() -> str:
    """The best encoder that is built in, as FFmpeg calls it.

    Raises:
        MissingDependency: there is none.
    """
    import av

    for name in ENCODERS:
        if name in av.codecs_available:
            return name
    raise MissingDependency(
        "PyAV without an encoder for MP4",
        want=" or ".join(ENCODERS),
        fix="Install the wheel of `av`.",
    )


def write_mp4(
    path: Path,
    pictures: Iterable[UInt8],
    ticks: Sequence[int],
    *,
    last_ticks: int,
    comment: str = "",
) -> None:
    """Write pictures as a video, one thread, so that the bytes depend on them alone.

    Args:
        path: appears whole or not at all.
        pictures: (H, W, 3) RGB each, of one even size.
        ticks: when each is shown, 1/90000 s, increasing from 0.
        last_ticks: how long the last one is shown.
        comment: kept in the file, for `mp4_comment`.

    Raises:
        StructureError: a picture of another or an odd size.
        OutputError: the disk is full or gone; nothing is left.
    """
    import av

    shown = dict(zip(ticks, [*np.diff(ticks).tolist(), last_ticks], strict=True))
    options = {"movflags": "+faststart", "fflags": "+bitexact"}
    with atomic_file(path) as file:
        # By name: putting the index in front needs to read what was written.
        try:
            with av.open(file.name, "w", format="mp4", options=options) as container:
                if comment:
                    container.metadata["comment"] = comment
                stream: Any = None
                for picture, start in zip(pictures, ticks, strict=True):
                    if stream is None:
                        stream = _stream(container, picture)
                    frame = _frame(picture, stream)
                    frame.pts = start
                    container.mux(_timed(stream.encode(frame), shown))
                if stream is not None:
                    container.mux(_timed(stream.encode(), shown))
        except av.error.FFmpegError as error:
            raise OSError(error.errno, error.strerror) from error


def mp4_comment(path: Path) -> str:
    """The comment that an MP4 was written with; nothing where it has none, or is cut or damaged."""
    import av

    if not _is_whole(path):
        return ""
    try:
        with av.open(str(path)) as container:
            return str(container.metadata.get("comment", ""))
    except av.error.FFmpegError:
        return ""


def _is_whole(path: Path) -> bool:
    """Whether the boxes of a file follow one another to its last byte.

    Source: ISO/IEC 14496-12, section 4.2.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            offset = 0
            while offset < size:
                file.seek(offset)
                head = file.read(LARGE_BOX_BYTES).ljust(LARGE_BOX_BYTES, b"\0")
                length = int.from_bytes(head[:4], "big")
                if length == 1:  # too long for 32 bits
                    length = int.from_bytes(head[8:], "big")
                if length < BOX_BYTES:
                    return False
                offset += length
    except OSError:
        return False
    return 0 < size == offset


def _stream(container: Any, picture: UInt8) -> Any:
    from fractions import Fraction

    encoder = mp4_encoder()
    stream = container.add_stream(encoder)
    stream.height, stream.width = picture.shape[:2]
    stream.pix_fmt, stream.gop_size = "yuv420p", KEY_EVERY
    stream.options = ENCODERS[encoder] | {"flags": "+bitexact"}
    context = stream.codec_context
    stream.time_base = context.time_base = Fraction(1, TICKS_PER_S)
    context.thread_count = 1
    # Frames in the order of presentation: else the time of the last one is lost in the container.
    context.max_b_frames = 0
    context.colorspace = context.color_primaries = context.color_trc = 1  # BT.709
    context.color_range = 1  # limited, which players take for granted
    return stream


def _timed(packets: list[Any], shown: dict[int, int]) -> list[Any]:
    """The packets, each with how long it is shown: encoders forget that of the last."""
    for packet in packets:
        packet.duration = shown[packet.pts]
    return packets


def _frame(picture: UInt8, stream: Any) -> Any:
    from av import VideoFrame
    from av.video.reformatter import ColorRange, Colorspace

    height, width = picture.shape[:2]
    if (width, height) != (stream.width, stream.height) or width % 2 or height % 2:
        raise StructureError(
            f"a picture of {width}x{height}",
            want=f"{stream.width}x{stream.height}, even",
            where="write_mp4",
        )
    return VideoFrame.from_ndarray(picture, "rgb24").reformat(
        format="yuv420p",
        dst_colorspace=Colorspace.ITU709,
        src_color_range=ColorRange.JPEG,
        dst_color_range=ColorRange.MPEG,
        threads=1,
    )
