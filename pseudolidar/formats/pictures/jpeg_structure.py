"""The marker structure of a JPEG: its size, and whether it reaches its end mark undamaged.

libjpeg invents what is missing and says so on stderr alone, so that this must be known before.
Source: ITU-T T.81, annex B.
"""

from __future__ import annotations

import re

from pseudolidar.errors import ImageFormat, ImageTruncated
from pseudolidar.formats.pictures.image_header import ImageHeader, truncated
from pseudolidar.formats.pictures.jpeg_scan import JpegScan, JpegState, scan_of

SOI, EOI, SOS, DRI, DHT = 0xD8, 0xD9, 0xDA, 0xDD, 0xC4
SIZES = (0xC0, 0xC1, 0xC2)  # baseline, extended and progressive Huffman: what libjpeg decodes
OTHER_SIZES = (0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF)
# What may follow a scan: tables, comments, further scans, the number of lines, the end.
AFTER_SCAN = {DHT, 0xDB, 0xDC, DRI, SOS, EOI, 0xFE, *range(0xE0, 0xF0)}
# The first marker after entropy-coded data that is not stuffing, a restart or a fill byte.
_SCAN_END = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_RESTART = re.compile(rb"\xff([\xd0-\xd7])")


def jpeg_header(data: bytes) -> ImageHeader:
    """Header of a JPEG: its frame segment.

    Raises:
        ImageTruncated: the file ends before it, or is damaged.
        ImageFormat: a JPEG that is neither 8-bit grey nor 8-bit colour.
    """
    at = 2
    while True:
        marker, start, end = _segment(data, at)
        if marker in SIZES:
            break
        if marker in OTHER_SIZES:
            raise ImageFormat("a lossless or arithmetic JPEG", want="a usual JPEG")
        if marker in (SOS, EOI):
            raise _corrupt(f"a scan at byte {at} before any size")
        at = end
    if end - start < 8:
        raise _corrupt(f"a short frame segment at byte {at}")
    bits, channels = data[start], data[start + 5]
    height, width = (int.from_bytes(data[start + i : start + i + 2], "big") for i in (1, 3))
    if bits != 8 or channels not in (1, 3):
        raise ImageFormat(
            f"a JPEG of {channels} channels of {bits} bits",
            want="grey or colour of 8 bits",
            fix="Export it as RGB.",
        )
    return ImageHeader(width, height, channels, bits)


def check_jpeg(data: bytes) -> None:
    """Walk all segments and scans to the end mark, and the codes of sequential scans.

    Found: a file that ends early, missing or wrong markers, a wrong order of restart marks, codes
    that are illegal or of the wrong number (see `jpeg_entropy` for what is not found).

    Raises:
        ImageTruncated: the end mark is missing, or the file is damaged.
    """
    at, state = 2, JpegState()
    while True:
        marker, start, end = _segment(data, at)
        if marker == EOI:
            break
        if state.scans and marker not in AFTER_SCAN:
            raise _corrupt(f"marker FF{marker:02X} at byte {at} after the image data")
        try:
            scan = _taken_in(state, marker, data[start:end])
        except ValueError as error:
            raise _corrupt(f"{error} at byte {at}") from None
        at = _scan_end(data, end, state.restart, scan) if marker == SOS else end
    if not state.scans:
        raise _corrupt("no image data")


def _taken_in(state: JpegState, marker: int, body: bytes) -> JpegScan | None:
    """Let a segment change the state; a scan segment gives what its data must hold."""
    if marker in SIZES:
        state.define_frame(marker, body)
    elif marker == DHT:
        state.define_tables(body)
    elif marker == DRI:
        state.restart = int.from_bytes(body, "big")
    elif marker == SOS:
        state.scans += 1
        return scan_of(state, body)
    return None


def _segment(data: bytes, at: int) -> tuple[int, int, int]:
    """Marker of the segment at `at`, where its body starts, and where the next one begins."""
    while data[at : at + 2] == b"\xff\xff":
        at += 1
    if at + 2 > len(data):
        raise _no_end(data)
    if data[at] != 0xFF:
        raise _corrupt(f"byte {data[at]:02X} at {at} where a marker must be")
    marker = data[at + 1]
    if marker == EOI:
        return marker, at + 2, at + 2
    if marker == SOI or marker < 0xC0 or 0xD0 <= marker <= 0xD7:
        raise _corrupt(f"marker FF{marker:02X} at byte {at} where a segment must be")
    if at + 4 > len(data):
        raise _no_end(data)
    size = int.from_bytes(data[at + 2 : at + 4], "big")
    if size < 2:
        raise _corrupt(f"a segment of {size} bytes at byte {at}")
    if at + 2 + size > len(data):
        raise _no_end(data)
    return marker, at + 4, at + 2 + size


def _scan_end(data: bytes, start: int, restart: int, scan: JpegScan | None) -> int:
    """Where the marker stands that ends the entropy-coded data from `start`, after checking it."""
    found = _SCAN_END.search(data, start)
    if found is None:
        raise _no_end(data)
    cuts = [start]
    for number, mark in enumerate(_RESTART.finditer(data, start, found.start())):
        if not restart or mark[1][0] != 0xD0 + number % 8:
            raise _corrupt(f"restart mark FF{mark[1][0]:02X} at byte {mark.start()}")
        cuts += [mark.start(), mark.end()]
    cuts.append(found.start())
    if scan is not None:
        _check_codes(data, scan, list(zip(cuts[0::2], cuts[1::2], strict=True)))
    return found.start()


def _check_codes(data: bytes, scan: JpegScan, intervals: list[tuple[int, int]]) -> None:
    from pseudolidar.formats.pictures.jpeg_entropy import damage_of

    left = scan.mcus
    for start, end in intervals:
        mcus = min(scan.restart or left, left)
        damage = damage_of(data[start:end], mcus, scan.blocks, scan.tables)
        if damage:
            raise _corrupt(f"{damage} between bytes {start} and {end}")
        left -= mcus
    if left:
        raise _corrupt(f"{left} of {scan.mcus} groups of blocks missing")


def _no_end(data: bytes) -> ImageTruncated:
    return truncated(data, "without its end mark (EOI)")


def _corrupt(what: str) -> ImageTruncated:
    return ImageTruncated(
        f"damaged JPEG: {what}", want="an undamaged file", fix="Copy the file again."
    )
