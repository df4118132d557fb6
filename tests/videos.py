"""Videos for tests, encoded by PyAV: known pictures in any container, codec and timing."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

LOSSLESS = {"codec": "ffv1", "pix_fmt": "bgr0"}
H264 = {"codec": "libx264", "pix_fmt": "yuv420p"}


def pictures(count: int, width: int = 64, height: int = 48, seed: int = 0) -> list[np.ndarray]:
    """Pictures that differ from each other everywhere, smooth enough for any codec."""
    import cv2

    rng = np.random.default_rng(seed)
    wide = rng.integers(0, 256, (height, width + 3 * count, 3), np.uint8)
    wide = cv2.GaussianBlur(wide, (0, 0), 1.5)
    wide = cv2.normalize(wide, None, 0, 255, cv2.NORM_MINMAX)
    return [np.ascontiguousarray(wide[:, 3 * i : 3 * i + width]) for i in range(count)]


def write_video(
    path: Path,
    frames: Sequence[np.ndarray],
    *,
    codec: str = "ffv1",
    pix_fmt: str = "bgr0",
    form: str | None = None,
    rate: Fraction | int = 10,
    ticks: Sequence[int] | None = None,
    time_base: Fraction | None = None,
    gop: int = 12,
    options: dict[str, str] | None = None,
    metadata: dict[str, str] | None = None,
    colorspace: int = 2,
    color_range: int = 0,
    aspect: Fraction | None = None,
) -> Path:
    """Encode `frames`, RGB or arrays of the pixel format `form`; `ticks` of `time_base` each."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        first = _frame(frames[0], form)
        stream.width, stream.height, stream.pix_fmt = first.width, first.height, pix_fmt
        stream.options = options or {}
        stream.gop_size = gop
        context: Any = stream.codec_context
        context.colorspace, context.color_range = colorspace, color_range
        if aspect is not None:
            context.sample_aspect_ratio = aspect
        if time_base is not None:
            stream.time_base = context.time_base = time_base
        stream.metadata.update(metadata or {})
        for index, picture in enumerate(frames):
            frame = _frame(picture, form)
            frame.pts = index if ticks is None else ticks[index]
            frame.time_base = time_base or 1 / Fraction(rate)
            frame.colorspace, frame.color_range = colorspace, color_range
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def decoded(path: Path) -> list[av.VideoFrame]:
    """All frames by plain decoding from the start, one thread."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.codec_context.thread_count = 1
        return list(container.decode(stream))


def turned(path: Path, quarters: int) -> Path:
    """Write a rotation into the track header of an MP4. Source: ISO/IEC 14496-12, 8.3.2."""
    one = 1 << 16
    matrix = {
        0: (one, 0, 0, one),
        1: (0, one, -one, 0),
        2: (-one, 0, 0, -one),
        3: (0, -one, one, 0),
    }
    a, b, c, d = matrix[quarters]
    numbers = (a, b, 0, c, d, 0, 0, 0, 1 << 30)
    data = bytearray(path.read_bytes())
    place = data.index(b"tkhd") + 4 + 4 + 20 + 8 + 8
    data[place : place + 36] = b"".join(n.to_bytes(4, "big", signed=True) for n in numbers)
    path.write_bytes(data)
    return path


def without_packets(source: Path, target: Path, left_out: Sequence[int]) -> Path:
    """A copy of a video that lacks some packets, in order of decoding."""
    with av.open(str(source)) as old, av.open(str(target), "w") as new:
        track = old.streams.video[0]
        copy = new.add_stream_from_template(track)
        for number, packet in enumerate(p for p in old.demux(track) if p.size):
            if number not in left_out:
                packet.stream = copy
                new.mux(packet)
    return target


def _frame(picture: np.ndarray, form: str | None) -> av.VideoFrame:
    if form != "yuv444p10le":  # which from_ndarray does not know
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), form or "rgb24")
    frame = av.VideoFrame(picture.shape[2], picture.shape[1], form)
    for plane, values in zip(frame.planes, picture, strict=True):
        rows = np.zeros((plane.height, plane.line_size // 2), "<u2")
        rows[:, : plane.width] = values
        plane.update(rows.tobytes())
    return frame
