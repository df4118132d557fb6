"""The compressions of MCAP chunks; unpacking yields exactly what was claimed, or fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from pseudolidar.formats.mcap.content import Compression

# Packed bytes that are read at once where only the start is wanted.
START_BLOCK_BYTES = 16 * 1024
# Packed bytes that are unpacked at once of data that may be damaged. Four bytes of zstd can make
# 128 KiB, so no more than 8 MiB beyond what is wanted.
PIECE_BYTES = 256


def compressed(data: bytes, compression: Compression) -> tuple[str, bytes]:
    """Name of the compression in the file, and `data` packed with it. Releases the GIL."""
    match compression:
        case "none":
            return "", data
        case "lz4":
            return "lz4", lz4.frame.compress(data)
        case "zstd":
            return "zstd", zstandard.compress(data)


def decompressed(data: bytes | memoryview, name: str, size: int) -> bytes | memoryview:
    """Unpack `data` to `size` bytes; no more are ever made.

    Args:
        data: packed.
        name: compression as the file names it.
        size: how many bytes there must be.

    Raises:
        ValueError: damaged, of another size, or an unknown compression.
    """
    try:
        match name:
            case "":
                result = data
            case "lz4":
                # One byte more than claimed shows data that holds more.
                result = lz4.frame.LZ4FrameDecompressor().decompress(data, size + 1)
            case "zstd":
                if zstandard.frame_content_size(data) not in (-1, size):
                    raise ValueError(f"another size than the {size} bytes it claims")
                result = zstandard.decompress(data, size)
            case _:
                raise ValueError(f"unknown compression {name!r}")
    except (RuntimeError, EOFError, zstandard.ZstdError) as error:
        raise ValueError(str(error)) from error
    if len(result) != size:
        raise ValueError(f"{len(result)} bytes where it claims {size}")
    return result


def decompressed_start(file: BinaryIO, name: str, packed_bytes: int, size: int) -> bytes:
    """The first `size` bytes of packed data that begins where `file` stands, or all of it.

    Args:
        file: read no further than needed.
        name: compression as the file names it.
        packed_bytes: length of the packed data.
        size: how many bytes are wanted.

    Raises:
        ValueError: damaged before that, or an unknown compression.
    """
    try:
        match name:
            case "":
                return file.read(min(packed_bytes, size))
            case "lz4":
                return _lz4_start(file, packed_bytes, size)
            case "zstd":
                stream = zstandard.ZstdDecompressor().stream_reader(
                    file, read_size=START_BLOCK_BYTES, closefd=False
                )
                return stream.read(size)
            case _:
                raise ValueError(f"unknown compression {name!r}")
    except (RuntimeError, EOFError, zstandard.ZstdError) as error:
        raise ValueError(str(error)) from error


def _lz4_start(file: BinaryIO, packed_bytes: int, size: int) -> bytes:
    data, stream = bytearray(), lz4.frame.LZ4FrameDecompressor()
    while len(data) < size and packed_bytes > 0 and not stream.eof:
        block = file.read(min(packed_bytes, START_BLOCK_BYTES))
        packed_bytes -= len(block)
        if not block:
            break
        data += stream.decompress(block, size - len(data))
    return bytes(data)


def leading_bytes(data: bytes | memoryview, name: str, most: int) -> bytes:
    """What can be unpacked of data that is cut or damaged, from its beginning.

    Args:
        data: packed, as far as it goes.
        name: compression as the file names it.
        most: bytes that are made at most.
    """
    match name:
        case "lz4":
            unpack: Callable[[bytes | memoryview], bytes] = (
                lz4.frame.LZ4FrameDecompressor().decompress
            )
        case "zstd":
            unpack = zstandard.ZstdDecompressor().decompressobj().decompress
        case _:
            return bytes(data[:most])
    result = bytearray()
    for start in range(0, len(data), PIECE_BYTES):
        try:
            result += unpack(data[start : start + PIECE_BYTES])
        except (RuntimeError, EOFError, zstandard.ZstdError):
            break
        if len(result) >= most:
            break
    return bytes(result[:most])
