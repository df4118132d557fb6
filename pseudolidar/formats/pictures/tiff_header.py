"""The directory of a TIFF 6.0 or BigTIFF: size, layout, and whether all strips are there."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from pseudolidar.errors import ImageFormat, ImageUnreadable
from pseudolidar.formats.pictures.image_header import ImageHeader, truncated

TIFF_TYPES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q"}
WIDTH, HEIGHT, BITS, PHOTOMETRIC = 256, 257, 258, 262
STRIP_OFFSETS, CHANNELS, STRIP_BYTES = 273, 277, 279
TILE_OFFSETS, TILE_BYTES, EXTRA, SAMPLE_FORMAT = 324, 325, 338, 339
FLOAT_SAMPLES = 3
PALETTE = 3


def tiff_header(data: bytes) -> ImageHeader:
    """Header of the first picture of a TIFF; checks that its strips or tiles are there.

    Raises:
        ImageTruncated: the file ends early.
        ImageUnreadable: the directory is not legal.
        ImageFormat: pixels that are not 8- or 16-bit integers.
    """
    try:
        tags, more = _tiff_tags(data)
    except struct.error:
        raise truncated(data, "within the directory") from None
    if WIDTH not in tags or HEIGHT not in tags:
        raise ImageUnreadable(
            "a TIFF without width and height", want="both", fix="Export it again."
        )
    offsets = tags.get(STRIP_OFFSETS) or tags.get(TILE_OFFSETS) or ()
    sizes = tags.get(STRIP_BYTES) or tags.get(TILE_BYTES) or ()
    need = max((start + size for start, size in zip(offsets, sizes, strict=False)), default=0)
    if len(data) < need:
        raise truncated(data, f"within the pixels that need {need}")
    if FLOAT_SAMPLES in tags.get(SAMPLE_FORMAT, ()):
        raise ImageFormat("a TIFF of floating-point pixels", want="8- or 16-bit integers")
    channels = tags.get(CHANNELS, (1,))[0]
    if tags.get(PHOTOMETRIC, (1,))[0] == PALETTE:
        channels = 3
    return ImageHeader(
        tags[WIDTH][0],
        tags[HEIGHT][0],
        channels,
        max(tags.get(BITS, (1,))),
        alpha=channels in (2, 4) and bool(tags.get(EXTRA)),
        notes=("first of several pictures in the file",) if more else (),
    )


def _tiff_tags(data: bytes) -> tuple[dict[int, tuple[int, ...]], bool]:
    """Integer tags of the first directory, and whether another one follows."""
    order = "<" if data[:2] == b"II" else ">"
    big = data[2:4] in (b"+\x00", b"\x00+")
    word, count_code, inline, entry_bytes = ("Q", "Q", 8, 20) if big else ("I", "H", 4, 12)
    (at,) = struct.unpack_from(order + word, data, 8 if big else 4)
    (entries,) = struct.unpack_from(order + count_code, data, at)
    at += struct.calcsize(order + count_code)
    if entries * entry_bytes > len(data):
        raise struct.error
    tags = dict(
        _tiff_entries(data, order, word, inline, range(at, at + entries * entry_bytes, entry_bytes))
    )
    (following,) = struct.unpack_from(order + word, data, at + entries * entry_bytes)
    return tags, bool(following)


def _tiff_entries(
    data: bytes, order: str, word: str, inline: int, places: range
) -> Iterator[tuple[int, tuple[int, ...]]]:
    for place in places:
        tag, code, count = struct.unpack_from(f"{order}HH{word}", data, place)
        if code not in TIFF_TYPES:
            continue
        if count > len(data):
            raise struct.error
        form = f"{order}{count}{TIFF_TYPES[code]}"
        value = place + 4 + struct.calcsize(order + word)
        if struct.calcsize(form) > inline:
            (value,) = struct.unpack_from(order + word, data, value)
        yield tag, struct.unpack_from(form, data, value)
