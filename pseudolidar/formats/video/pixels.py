"""A decoded frame as RGB or grey: its own matrix and range, its depth, its rotation."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from pseudolidar.formats.pictures.image import DecodedImage
from pseudolidar.structures.arrays import Image

if TYPE_CHECKING:
    from av import VideoFrame

# AVColorSpace of a frame -> the matrix that swscale knows it by, and its name.
# Source: libavutil/pixfmt.h and libswscale/swscale.h; ITU-T H.273, table 4.
MATRICES = {
    1: (1, "BT.709"),
    4: (4, "FCC"),
    5: (5, "BT.601"),
    6: (5, "BT.601"),
    7: (7, "SMPTE 240M"),
    9: (9, "BT.2020"),
    10: (9, "BT.2020"),
}
BT601, BT709 = MATRICES[5], MATRICES[1]
LIMITED, FULL = 1, 2
# Where a file does not name its matrix, more lines than this mean BT.709, as in players.
MOST_LINES_OF_BT601 = 576
_LOCAL = threading.local()


def matrix_of(colorspace: int, lines: int) -> tuple[int, str]:
    """The matrix of a YUV picture: the one that is named, else BT.709 above 576 lines, BT.601."""
    return MATRICES.get(colorspace) or (BT709 if lines > MOST_LINES_OF_BT601 else BT601)


def colour_note(context: Any) -> str:
    """How the colours of a stream are read, for people."""
    kind = context.format
    if kind is None or kind.is_rgb:
        return ""
    deep = max(part.bits for part in kind.components) > 8
    if _is_grey(kind):
        return "grey of more than 8 bits: 16-bit values as stored" if deep else ""
    named = context.colorspace in MATRICES
    matrix = matrix_of(context.colorspace, context.height)[1]
    depth = f", {max(part.bits for part in kind.components)} bits to 16-bit RGB" if deep else ""
    assumed = "" if named else ", assumed from the size"
    full = _is_full(kind, context.color_range)
    return f"colours: {matrix}{assumed}, {'full' if full else 'limited'} range{depth}"


def to_pixels(
    frame: VideoFrame, *, rotated: bool, smaller_px: tuple[int, int] | None = None
) -> DecodedImage:
    """Pixels of a frame: RGB, or grey where the video is grey.

    8 bits a channel stay 8 bits; RGB too keeps its values. Deeper colour becomes 16-bit RGB with
    white at 65535; deeper grey keeps its values in 16 bits.

    Args:
        frame: as decoded.
        rotated: turned as the file says that it is to be shown, by quarters.
        smaller_px: (width, height) of the result, as turned, where it is to be smaller: each pixel
            is the mean of the area that it covers. That is done before colours are converted, which
            is less work then.
    """
    kind = frame.format
    deep = max(part.bits for part in kind.components) > 8
    quarters = round(frame.rotation / 90) % 4 if rotated else 0
    if smaller_px is not None and quarters % 2:
        smaller_px = smaller_px[::-1]
    pixels = _grey(frame, smaller_px) if _is_grey(kind) else _rgb(frame, smaller_px, deep=deep)
    notes = []
    if any(part.is_alpha for part in kind.components) and kind.name not in ("bgr0", "rgb0"):
        notes.append("alpha channel dropped")
    if frame.interlaced_frame:
        notes.append("interlaced: the two fields are of different moments")
    if quarters:
        pixels = np.rot90(pixels, quarters)
        notes.append(f"rotated by {90 * quarters} degrees anticlockwise, as the video says")
    return DecodedImage(cast("Image", np.ascontiguousarray(pixels)), tuple(notes))


def _grey(frame: VideoFrame, smaller_px: tuple[int, int] | None) -> Image:
    if frame.color_range == LIMITED or smaller_px is not None:
        deep = frame.format.components[0].bits > 8
        name, limited = "gray16le" if deep else "gray", frame.color_range == LIMITED
        source_range = LIMITED if limited else FULL
        frame = _reformatted(frame, name, BT601[0], source_range, smaller_px)
    plane = frame.planes[0]
    dtype = np.dtype(np.uint8 if frame.format.components[0].bits <= 8 else np.uint16)
    if frame.format.is_big_endian and dtype.itemsize > 1:
        dtype = dtype.newbyteorder(">")
    rows = np.frombuffer(plane, dtype).reshape(plane.height, -1)
    return cast("Image", rows[:, : plane.width].astype(dtype.newbyteorder("=")))


def _rgb(frame: VideoFrame, smaller_px: tuple[int, int] | None, *, deep: bool) -> Image:
    full = _is_full(frame.format, frame.color_range)
    matrix = matrix_of(frame.colorspace, frame.height)[0]
    name = "rgb48le" if deep else "rgb24"
    source_range = FULL if full or frame.format.is_rgb else LIMITED
    rgb = _reformatted(frame, name, matrix, source_range, smaller_px)
    plane = rgb.planes[0]
    dtype = np.dtype("<u2" if deep else np.uint8)
    rows = np.frombuffer(plane, dtype).reshape(rgb.height, -1)
    pixels = rows[:, : 3 * rgb.width].reshape(rgb.height, rgb.width, 3)
    return cast("Image", pixels.astype(dtype.newbyteorder("="), copy=True))


def _reformatted(
    frame: VideoFrame,
    name: str,
    matrix: int,
    source_range: int,
    smaller_px: tuple[int, int] | None,
) -> VideoFrame:
    """Converted by the thread's own converter: making one takes as long as using it."""
    from av.video.reformatter import Interpolation, VideoReformatter

    converter = getattr(_LOCAL, "converter", None)
    if converter is None:
        converter = _LOCAL.converter = VideoReformatter()
    width, height = smaller_px or (frame.width, frame.height)
    filtered = Interpolation.BILINEAR if smaller_px is None else Interpolation.AREA
    careful = filtered | Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INT
    if smaller_px is not None and frame.format.is_rgb:
        careful |= Interpolation.FULL_CHR_H_INP  # else its colours are halved on the way
    return cast(
        "VideoFrame",
        converter.reformat(
            frame,
            width=width,
            height=height,
            format=name,
            src_colorspace=matrix,
            src_color_range=source_range,
            dst_color_range=FULL,
            interpolation=int(careful),
            threads=1,
        ),
    )


def _is_grey(kind: Any) -> bool:
    return len(kind.components) == 1 and not kind.is_rgb and not kind.has_palette


def _is_full(kind: Any, color_range: int) -> bool:
    return bool(color_range == FULL or kind.name.startswith("yuvj"))
