"""Disparities with their sigmas in a few bytes, for runs that come back to them.

A file is a header, then two planes of 16-bit numbers, compressed: disparity in steps of 1/256 px, 0
where there is none, and sigma in steps of 1/1024 px.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from pseudolidar.errors import ImageUnreadable
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.structures.arrays import AnyArray, Bool, Float32
from pseudolidar.structures.disparity import DisparityMap

MAGIC = b"PLdisp1\0"
# Height, width, CRC-32 of the planes.
HEADER = struct.Struct("<8sIII")
PER_PX, PER_SIGMA_PX = 256, 1024
LEVEL = 1


def encode_disparity(disparity: DisparityMap) -> bytes:
    """The bytes of a file; what is above 255 px, or a sigma above 63 px, is stored as that."""
    import zstandard

    height, width = disparity.values.shape
    sigma = disparity.sigma
    planes = np.stack(
        [
            _stored(disparity.values, PER_PX),
            np.zeros((height, width), np.uint16) if sigma is None else _stored(sigma, PER_SIGMA_PX),
        ]
    ).astype("<u2")
    raw = planes.tobytes()
    header = HEADER.pack(MAGIC, height, width, crc32(raw))
    return header + zstandard.ZstdCompressor(level=LEVEL).compress(raw)


def decode_disparity(
    data: bytes, path: Path | None = None, *, limits: Limits = DEFAULT_LIMITS
) -> DisparityMap:
    """The map of a file.

    Args:
        data: all its bytes.
        path: for errors.
        limits: caps on its size.

    Raises:
        ImageUnreadable: it is none, or damaged.
    """
    import zstandard

    def fault(got: str) -> ImageUnreadable:
        return ImageUnreadable(got, want="disparities as this package stores them", path=path)

    if len(data) < HEADER.size or not data.startswith(MAGIC):
        raise fault(f"{len(data)} bytes that do not begin as such a file")
    _, height, width, checksum = HEADER.unpack_from(data)
    if not 0 < height * width <= limits.pixels:
        raise fault(f"{width}x{height} pixels")
    try:
        raw = zstandard.ZstdDecompressor().decompress(
            data[HEADER.size :], max_output_size=4 * height * width
        )
    except zstandard.ZstdError as error:
        raise fault(f"it does not decompress: {error}") from None
    if len(raw) != 4 * height * width or crc32(raw) != checksum:
        raise fault("its content is not what was written")
    values, sigma = np.frombuffer(raw, "<u2").reshape(2, height, width)
    known = values > 0
    return DisparityMap(_restored(values, known, PER_PX), _restored(sigma, known, PER_SIGMA_PX))


def _stored(values: Float32, steps: int) -> AnyArray:
    highest = np.iinfo(np.uint16).max
    # What is there is never 0: that says that there is nothing.
    scaled = np.clip(np.rint(np.nan_to_num(values) * np.float32(steps)), 1, highest)
    return np.where(np.isfinite(values), scaled, 0).astype(np.uint16)


def _restored(stored: AnyArray, known: Bool, steps: int) -> Float32:
    restored = stored.astype(np.float32) / np.float32(steps)
    restored[~known] = np.nan
    return restored
