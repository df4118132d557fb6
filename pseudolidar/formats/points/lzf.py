"""LZF, the compression of PCD's `binary_compressed`: kernels and their checks.

A stream of runs: a control byte c < 32 is followed by c + 1 literal bytes; otherwise a copy of
`(c >> 5) + 2` bytes (7 means: add the next byte) from `((c & 31) << 8 | next) + 1` bytes back.

Source: format of Marc Lehmann's liblzf, which PCL and open3d use.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numba import njit

from pseudolidar.errors import PointFileCorrupt, StructureError
from pseudolidar.structures.arrays import Int64, UInt8

# Most bytes that the 3 bytes of one copy can stand for.
LARGEST_COPY = 264
LARGEST_EXPANSION = LARGEST_COPY // 3
# Sizes are 32-bit in PCD.
LARGEST_BLOCK = 2**32 - 1
_FARTHEST = 8192
_LONGEST_LITERAL = 32
_SHORTEST_COPY = 3
_HASH_BITS = 16


def compress(data: UInt8) -> bytes:
    """LZF stream of `data` (N,) uint8. Releases the GIL.

    Raises:
        StructureError: more bytes than PCD can hold compressed.
    """
    worst = len(data) + len(data) // _LONGEST_LITERAL + 2
    if worst > LARGEST_BLOCK:
        raise StructureError(
            f"{len(data)} bytes to compress",
            want=f"at most {LARGEST_BLOCK}",
            fix="Write it uncompressed.",
        )
    out = np.empty(worst, np.uint8)
    table = np.full(1 << _HASH_BITS, -1, np.int64)
    size = _compress(np.ascontiguousarray(data), out, table)
    return out[:size].tobytes()


def decompress(stream: UInt8, size: int) -> UInt8:
    """(size,) uint8 bytes that `stream` (M,) uint8 stands for. Releases the GIL.

    Raises:
        PointFileCorrupt: it is no LZF, or stands for another number of bytes; with its byte.
    """
    if size > len(stream) * LARGEST_EXPANSION:
        raise PointFileCorrupt(
            f"{len(stream)} bytes that claim to expand to {size}",
            want=f"at most {len(stream) * LARGEST_EXPANSION}",
        )
    out = np.empty(size, np.uint8)
    read, written = cast("tuple[int, int]", _decompress(stream, out))
    if read != len(stream) or written != size:
        raise PointFileCorrupt(
            f"compressed points that break off after {written} of {size} bytes",
            want="an undamaged file",
            fix="Copy or make the file again.",
            where=f"compressed byte {read}",
        )
    return out


def _compress_kernel(data: UInt8, out: UInt8, table: Int64) -> int:
    """Greedy LZF: `table` maps a hash of 3 bytes to where they were last seen."""
    n = len(data)
    at, to, literals = 0, 1, 0  # out[to - literals - 1] is the control byte of the open run
    while at < n:
        length, back = 0, 0
        if at + _SHORTEST_COPY <= n:
            key = (np.int64(data[at]) << 16) | (np.int64(data[at + 1]) << 8) | data[at + 2]
            slot = ((key * 2654435761) >> 12) & (len(table) - 1)
            seen = table[slot]
            table[slot] = at
            if seen >= 0 and at - seen <= _FARTHEST:
                longest = min(n - at, LARGEST_COPY)
                while length < longest and data[seen + length] == data[at + length]:
                    length += 1
                back = at - seen - 1
        if length >= _SHORTEST_COPY:
            to = _close_literals(out, to, literals)
            literals = 0
            code = length - 2
            if code < 7:
                out[to] = (code << 5) | (back >> 8)
                to += 1
            else:
                out[to] = (7 << 5) | (back >> 8)
                out[to + 1] = code - 7
                to += 2
            out[to] = back & 255
            to += 2  # and room for the next control byte
            at += length
        else:
            out[to] = data[at]
            to, at, literals = to + 1, at + 1, literals + 1
            if literals == _LONGEST_LITERAL:
                to = _close_literals(out, to, literals) + 1
                literals = 0
    return int(_close_literals(out, to, literals))


def _close_literals_kernel(out: UInt8, to: int, literals: int) -> int:
    """Fill in the open run's control byte; where the next code goes (over it, if it is empty)."""
    if literals == 0:
        return to - 1
    out[to - literals - 1] = literals - 1
    return to


def _decompress_kernel(stream: UInt8, out: UInt8) -> tuple[int, int]:
    """Expand until the stream or the room ends, or a code is illegal; bytes read and written."""
    at, to, n, room = 0, 0, len(stream), len(out)
    while at < n:
        control: Any = np.int64(stream[at])  # unsigned and signed would mix to a float
        if control < _LONGEST_LITERAL:
            length = control + 1
            if at + 1 + length > n or to + length > room:
                return at, to
            for i in range(length):
                out[to + i] = stream[at + 1 + i]
            at += 1 + length
        else:
            length, extra = control >> 5, 0
            if length == 7:
                if at + 1 >= n:
                    return at, to
                length, extra = length + stream[at + 1], 1
            length += 2
            if at + 1 + extra >= n:
                return at, to
            source = to - (((control & 31) << 8) | stream[at + 1 + extra]) - 1
            if source < 0 or to + length > room:
                return at, to
            for i in range(length):
                out[to + i] = out[source + i]
            at += 2 + extra
        to += length
    return at, to


_close_literals = njit(cache=True, nogil=True)(_close_literals_kernel)
_compress = njit(cache=True, nogil=True)(_compress_kernel)
_decompress = njit(cache=True, nogil=True)(_decompress_kernel)
