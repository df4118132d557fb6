"""The compressions of MCAP chunks; unpacking yields exactly what was claimed, or fails."""

from __future__ import annotations

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from pseudolidar.formats.mcap_content import Compression


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
