"""Walks the Huffman codes of a JPEG, without decoding it, to find damage that libjpeg hides.

What libjpeg says on stderr alone is found here: codes that do not exist, blocks with too many
coefficients, data that end early, data left over. Not found: a changed bit that leaves all codes
legal and their number right (a coefficient of another value), and damage in progressive scans,
whose structure alone is checked.

Source: ITU-T T.81, annexes C and F.2.
"""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt
from numba import int64, njit, types, uint8, uint16, uint64

# Longest code, bits; a table is indexed by as many.
CODE_BITS = 16
SHORT_BITS = 10
# A code and what follows it take up to 31 bits; a byte more still fits into 64.
REFILL_BITS = 48
BLOCK = 64
ZERO_RUN = 0xF0  # 16 zeros
# A fill that encoders write before the next marker.
FILL = b"\xff"

# Why a walk ended early; otherwise it returns the bits that were left over.
NO_CODE, TOO_MANY, TOO_SHORT = -1, -2, -3
REASONS = {
    NO_CODE: "a code that does not exist",
    TOO_MANY: "a block of more than 64 coefficients",
    TOO_SHORT: "too few data",
}


@njit(
    int64(
        types.Array(uint8, 1, "C", readonly=True),
        int64,
        types.Array(int64, 2, "C", readonly=True),
        types.Array(uint16, 2, "C", readonly=True),
        types.Array(uint16, 2, "C", readonly=True),
    ),
    nogil=True,
    cache=True,
)
def walk_blocks(data, mcus, blocks, tables, short):  # type: ignore[no-untyped-def]
    """Walk `mcus` groups of blocks.

    Args:
        data: (n,) uint8 entropy-coded bytes, stuffing taken out.
        mcus: groups of blocks.
        blocks: (B, 2) int64 rows of `tables` for the DC and AC codes of each block of a group.
        tables: (T, 65536) uint16 code length * 256 + symbol by the next 16 bits; 0 = no code.
        short: (T, 1024) uint16 the same for codes of up to 10 bits, small enough for the cache.

    Returns:
        Bits that were left over, or `NO_CODE`, `TOO_MANY`, `TOO_SHORT`.
    """
    window, held = uint64(0), int64(0)
    at, end = uint64(0), uint64(len(data))
    for _ in range(mcus):
        for block in range(len(blocks)):
            dc, ac = uint64(blocks[block, 0]), uint64(blocks[block, 1])
            k, table = int64(0), dc
            while k < BLOCK:
                while held <= REFILL_BITS and at < end:
                    window = (window << uint64(8)) | uint64(data[at])
                    held, at = held + 8, at + uint64(1)
                if held >= CODE_BITS:
                    peek = (window >> uint64(held - CODE_BITS)) & uint64(0xFFFF)
                else:
                    peek = (window << uint64(CODE_BITS - held)) & uint64(0xFFFF)
                entry = int64(short[table, peek >> uint64(CODE_BITS - SHORT_BITS)])
                if entry == 0:
                    entry = int64(tables[table, peek])
                    if entry == 0:
                        return NO_CODE if held >= CODE_BITS else TOO_SHORT
                symbol = entry & 0xFF
                extra = symbol & 0x0F
                held -= (entry >> 8) + extra
                if held < 0:
                    return TOO_SHORT
                if k == 0:
                    k, table = 1, ac
                elif extra == 0 and symbol != ZERO_RUN:
                    break
                else:
                    k += (symbol >> 4) + 1
                    if k > BLOCK:
                        return TOO_MANY
    return held + 8 * int64(end - at)


@functools.lru_cache(maxsize=16)
def code_tables(
    definitions: tuple[tuple[bytes, bytes], ...],
) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16]]:
    """Tables of codes as `walk_blocks` takes them, from 16 counts and symbols each (annex C)."""
    tables = np.zeros((len(definitions), 1 << CODE_BITS), np.uint16)
    for table, (counts, symbols) in zip(tables, definitions, strict=True):
        lengths = np.repeat(np.arange(1, CODE_BITS + 1), np.frombuffer(counts, np.uint8))
        entries = lengths * 256 + np.frombuffer(symbols, np.uint8)
        codes = np.repeat(entries, 1 << (CODE_BITS - lengths))[: len(table)]
        table[: len(codes)] = codes
    short = tables[:, :: 1 << (CODE_BITS - SHORT_BITS)].copy()
    short[short >> 8 > SHORT_BITS] = 0
    tables.setflags(write=False)
    short.setflags(write=False)
    return tables, short


def damage_of(
    data: bytes,
    mcus: int,
    blocks: tuple[tuple[int, int], ...],
    definitions: tuple[tuple[bytes, bytes], ...],
) -> str:
    """What is wrong with the entropy-coded data between two markers; "" if nothing.

    Args:
        data: the bytes as in the file.
        mcus: groups of blocks that they must hold.
        blocks: which of `definitions` the DC and AC codes of each block of a group use.
        definitions: counts and symbols of the Huffman tables.
    """
    plain = np.frombuffer(data.rstrip(FILL).replace(b"\xff\x00", b"\xff"), np.uint8)
    places = np.array(blocks, np.int64)
    places.setflags(write=False)
    left = int(walk_blocks(plain, mcus, places, *code_tables(definitions)))
    if left in REASONS:
        return REASONS[left]
    return f"{left // 8} bytes too many" if left >= 8 else ""
