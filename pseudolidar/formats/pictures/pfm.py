"""PFM, Middlebury's float maps: rows from bottom to top, infinite = none."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    ImageFormat,
    ImageMissing,
    ImageTruncated,
    ImageUnreadable,
    LimitError,
    PseudolidarError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.formats.pictures.image_kinds import content_kind
from pseudolidar.formats.whole_read import read_whole
from pseudolidar.structures.arrays import Float32
from pseudolidar.structures.disparity import DepthMap, DisparityMap

# Kind, width, height, scale (its sign is the byte order), each with one or more blanks behind it;
# behind the scale exactly one, or CR LF.
_HEADER = re.compile(
    rb"(P[fF])\s+(\d{1,9})\s+(\d{1,9})\s+([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(\s)"
)
_HEADER_BYTES = 256
_VALUE_BYTES = 4


def write_pfm(path: Path, values: DisparityMap | DepthMap) -> None:
    """Write a map, without its sigma.

    Raises:
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_pfm(values))


def read_pfm(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> DisparityMap:
    """Read disparities in px; what is not finite or not positive is none.

    Raises:
        ImageMissing: no such file.
        ImageTruncated: the file ends early.
        ImageUnreadable: no PFM, an illegal header, or bytes behind the last pixel.
        ImageFormat: a colour PFM.
        LimitError: more pixels than `limits.pixels`.
    """
    return DisparityMap(_read(path, limits))


def read_depth_pfm(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> DepthMap:
    """Read depths in metres; what is not finite or not positive is none. Errors as `read_pfm`."""
    return DepthMap(_read(path, limits))


def encode_pfm(values: DisparityMap | DepthMap) -> bytes:
    """The bytes of a little-endian PFM, every value as it is."""
    height, width = values.values.shape
    pixels = np.where(values.valid, values.values, np.float32(np.inf))[::-1]
    return f"Pf\n{width} {height}\n-1.0\n".encode("ascii") + pixels.astype("<f4").tobytes()


def decode_pfm(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> Float32:
    """(H, W) float32 values, NaN = none; errors as in `read_pfm`.

    The scale's size says nothing about the values (Middlebury has 1/255 there): only its sign is
    used.
    """
    match = _HEADER.match(data[:_HEADER_BYTES])
    if match is None:
        raise _no_header(data)
    width, height, scale = int(match[2]), int(match[3]), float(match[4])
    if match[1] == b"PF":
        raise ImageFormat(
            "a colour PFM (PF)", want="one channel (Pf)", fix="Export the map as one channel."
        )
    if scale == 0 or width < 1 or height < 1:
        raise ImageUnreadable(
            f"{width}x{height} pixels, scale {scale:g}", want="a size, and a scale with a sign"
        )
    if width * height > limits.pixels:
        raise LimitError(
            f"{width}x{height} pixels claimed",
            want=f"at most {limits.pixels}",
            fix=raise_cap("pixels"),
        )
    start = _checked_start(data, match.end(), width * height * _VALUE_BYTES)
    pixels = np.frombuffer(data, "<f4" if scale < 0 else ">f4", width * height, start)
    values = pixels.reshape(height, width)[::-1].astype(np.float32)
    values[~(np.isfinite(values) & (values > 0))] = np.nan
    return values


def _checked_start(data: bytes, start: int, size: int) -> int:
    """Where the pixels begin, all of which are there and nothing else."""
    if data[start - 1 : start + 1] == b"\r\n" and len(data) == start + 1 + size:
        return start + 1
    if len(data) < start + size:
        raise ImageTruncated(
            f"{len(data)} bytes",
            want=f"{start + size}",
            fix="Copy the file again: it ends early.",
            where=f"byte {len(data)}",
        )
    if len(data) > start + size:
        raise ImageUnreadable(
            f"{len(data) - start - size} bytes behind the last pixel",
            want="the end of the file",
            where=f"byte {start + size}",
        )
    return start


def _no_header(data: bytes) -> PseudolidarError:
    if len(data) < _HEADER_BYTES and re.fullmatch(rb"(P([fF]([\s\d.eE+-]*))?)?", data):
        return ImageTruncated(
            f"{len(data)} bytes, within the header", want="a PFM", where=f"byte {len(data)}"
        )
    kind = content_kind(data)
    return ImageUnreadable(
        f"content that is a {kind}" if kind not in ("", "PFM") else "no legal PFM header",
        want="Pf, width, height and scale",
        where="byte 0",
    )


def _read(path: Path, limits: Limits) -> Float32:
    try:
        return decode_pfm(read_whole(path), limits=limits)
    except OSError as error:
        raise ImageMissing(error.strerror or str(error), want="a PFM", path=path) from error
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__
