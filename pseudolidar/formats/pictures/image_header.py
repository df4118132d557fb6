"""Headers of pictures, parsed before a decoder sees them: size, layout, is it all there."""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass

from pseudolidar.errors import ImageFormat, ImageTruncated, ImageUnreadable


@dataclass(frozen=True)
class ImageHeader:
    """What a picture's header claims.

    Args:
        width_px: width.
        height_px: height.
        channels: channels of a pixel as stored, alpha included; a palette counts as its colours.
        bits: bits of a channel.
        alpha: whether the last channel is alpha.
        notes: what is odd about it.
    """

    width_px: int
    height_px: int
    channels: int
    bits: int
    alpha: bool = False
    notes: tuple[str, ...] = ()

    @property
    def is_grey(self) -> bool:
        """One channel besides alpha."""
        return self.channels - self.alpha == 1


def truncated(data: bytes, place: str) -> ImageTruncated:
    """The error of a file that ends early: how many bytes there are, and in what they end."""
    return ImageTruncated(
        f"the file ends after {len(data)} bytes, {place}",
        want="a complete file",
        fix="Copy the file again.",
    )


# --- PNG (W3C PNG, third edition) ----------------------------------------------------------

PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}


def png_header(data: bytes) -> ImageHeader:
    """Header of a PNG, `IHDR` alone.

    Raises:
        ImageTruncated: the file ends within it.
        ImageUnreadable: it is not legal.
    """
    if len(data) < 33:
        raise truncated(data, "within the header")
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    if data[12:16] != b"IHDR" or colour not in PNG_CHANNELS:
        raise ImageUnreadable(
            "a PNG without a legal header",
            want="size and kind of its pixels",
            fix="Copy the file again.",
        )
    bits = 8 if colour == 3 else bits
    return ImageHeader(width, height, PNG_CHANNELS[colour], bits, alpha=colour in (4, 6))


def check_png(data: bytes) -> None:
    """Check that every chunk of a PNG is there and has its check sum, up to the end mark.

    Raises:
        ImageTruncated: the file ends early.
        ImageUnreadable: a chunk is corrupted.
    """
    at, view = 8, memoryview(data)
    while True:
        if at + 12 > len(data):
            raise truncated(data, f"before its end mark, after the chunk at byte {at}")
        size, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 12 + size
        if end > len(data):
            raise truncated(data, f"within the chunk at byte {at} that needs {end}")
        if zlib.crc32(view[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise ImageUnreadable(
                f"chunk {kind!r} at byte {at} does not match its check sum",
                want="an undamaged PNG",
                fix="Copy the file again.",
            )
        if kind == b"IEND":
            return
        at = end


# --- PGM and PPM (netpbm) ------------------------------------------------------------------

_PNM = re.compile(rb"P([2356])" + rb"(?:\s+|\s*#[^\n]*\n)+(\d{1,9})" * 3 + rb"(\s)")
NUMBER = re.compile(rb"\d+")
COMMENT = re.compile(rb"#[^\n]*")


def pnm_header(data: bytes) -> tuple[ImageHeader, int]:
    """Header of a PGM or PPM, and the byte at which its pixels begin.

    Raises:
        ImageUnreadable: the header is not legal.
    """
    match = _PNM.match(data[:4096])
    if match is None:
        raise ImageUnreadable(
            "a PGM or PPM without a legal header",
            want="P5 or P6, width, height and largest value",
            fix="Export it again.",
        )
    width, height, largest = (int(match[i]) for i in (2, 3, 4))
    if not 0 < largest < 65536:
        raise ImageUnreadable(f"largest value {largest}", want="1 to 65535")
    bits, stated = (16, 65535) if largest > 255 else (8, 255)
    notes = () if largest == stated else (f"values up to {largest} kept as they are",)
    channels = 1 if match[1] in b"25" else 3
    return ImageHeader(width, height, channels, bits, notes=notes), match.end()


def check_pnm(data: bytes, header: ImageHeader, start: int) -> None:
    """Check that all pixels of a PGM or PPM are there.

    Raises:
        ImageTruncated: the file ends early.
    """
    values = header.width_px * header.height_px * header.channels
    if data[1:2] in b"56":
        need = start + values * (header.bits // 8)
        if len(data) < need:
            raise truncated(data, f"within the pixels that need {need}")
    else:
        have = len(NUMBER.findall(COMMENT.sub(b"", data[start:])))
        if have < values:
            raise truncated(data, f"after {have} of {values} values")


# --- BMP -----------------------------------------------------------------------------------

BMP_UNCOMPRESSED = (0, 3, 6)


def bmp_header(data: bytes) -> ImageHeader:
    """Header of a BMP; checks that all pixels of an uncompressed one are there.

    Raises:
        ImageTruncated: the file ends early.
        ImageUnreadable: bits of a pixel that no BMP has.
    """
    if len(data) < 54:
        raise truncated(data, "within the header")
    start, _, width, height, _, bits, compression = struct.unpack_from("<IIiiHHI", data, 10)
    if bits not in (1, 4, 8, 16, 24, 32):
        raise ImageUnreadable(f"a BMP of {bits} bits a pixel", want="8, 24 or 32")
    need = start + (width * bits + 31) // 32 * 4 * abs(height)
    if compression in BMP_UNCOMPRESSED and len(data) < need:
        raise truncated(data, f"within the pixels that need {need}")
    channels = 4 if bits == 32 else 1 if bits <= 8 and _grey_palette(data, bits) else 3
    return ImageHeader(width, abs(height), channels, 8, alpha=bits == 32)


def _grey_palette(data: bytes, bits: int) -> bool:
    header_bytes, colours = struct.unpack_from("<I28xI", data, 14)
    start = 14 + header_bytes
    palette = data[start : start + 4 * (min(colours, 256) or 2**bits)]
    return palette[0::4] == palette[1::4] == palette[2::4]


# --- WebP (RFC 9649) -----------------------------------------------------------------------


def webp_header(data: bytes) -> ImageHeader:
    """Header of a WebP; checks that all its chunks are there.

    Raises:
        ImageTruncated: the file ends early.
        ImageFormat: an animation.
    """
    if len(data) < 30:
        raise truncated(data, "within the header")
    need = int.from_bytes(data[4:8], "little") + 8
    if len(data) < need:
        raise truncated(data, f"of {need}")
    kind, body = data[12:16], data[20:30]
    if kind == b"VP8X":
        if body[0] & 0x02:
            raise ImageFormat("an animated WebP", want="one picture", fix="Export single frames.")
        width, height = (int.from_bytes(body[i : i + 3], "little") + 1 for i in (4, 7))
        alpha = bool(body[0] & 0x10)
    elif kind == b"VP8L":
        bits = int.from_bytes(body[1:5], "little")
        width, height, alpha = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1, bool(bits >> 28 & 1)
    else:
        width, height = (n & 0x3FFF for n in struct.unpack_from("<HH", body, 6))
        alpha = False
    return ImageHeader(width, height, 3 + alpha, 8, alpha=alpha)
