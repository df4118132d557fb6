"""Columns to packed records, one a point: the body of binary PCD and PLY files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pseudolidar.structures.arrays import AnyArray, UInt8

# Records filled at once: all columns of a block stay in the cache (measured: 4.7 ms whole, 2.6 ms
# so, for 400 000 points of 32 bytes).
_BLOCK = 8192


def interleave(columns: Mapping[str, AnyArray]) -> UInt8:
    """Bytes of little-endian records of `columns`, each (N,), in their order and without gaps."""
    dtype = np.dtype([(name, c.dtype.newbyteorder("<")) for name, c in columns.items()])
    count = len(next(iter(columns.values())))
    records = np.empty(count, dtype)
    for start in range(0, count, _BLOCK):
        block = records[start : start + _BLOCK]
        for name, column in columns.items():
            block[name] = column[start : start + _BLOCK]
    return records.view(np.uint8)
