"""Tables of numbers as text, one row a line: the body of ASCII PCD and PLY files."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from pseudolidar.errors import PointFileCorrupt, PointFileTruncated
from pseudolidar.formats.points.point_file import check_claim
from pseudolidar.structures.arrays import AnyArray, Float64, Int64

# Digits that bring every value back: IEEE 754 single 9, double 17.
_DIGITS = {"<f4": "%.9g", "<f8": "%.17g"}
SHORTEST_VALUE = 2  # bytes: a digit and what separates it
_ROWS_AT_ONCE = 20_000  # bounds the memory of Python objects
_NUMBER_BYTES = b"0123456789+-.eE" + b"naifNAIFtyTY" + b" \t\r\n"  # and nan, inf, infinity
_LARGEST_EXACT = 2.0**53  # whole numbers up to here are exact in a double
_NEWLINE, _SPACE = 10, 32  # every byte up to the space separates words

Dtype = np.dtype[Any]


def encode_table(columns: Sequence[AnyArray]) -> bytes:
    """Rows of `columns`, each (N,), with all their digits; every line ends with a newline."""
    row = " ".join(_DIGITS.get(column.dtype.str, "%d") for column in columns) + "\n"
    parts = []
    for start in range(0, len(columns[0]), _ROWS_AT_ONCE):
        block = [column[start : start + _ROWS_AT_ONCE].tolist() for column in columns]
        values = itertools.chain.from_iterable(zip(*block, strict=True))
        parts.append((row * len(block[0])) % tuple(values))
    return "".join(parts).encode("ascii")


def without_blank_lines(body: bytes) -> bytes:
    """The lines of `body` that hold something.

    Raises:
        PointFileTruncated: the last of them does not end with a newline: it may be cut.
    """
    if body.rstrip(b" \t\r") and not body.rstrip(b" \t\r").endswith(b"\n"):
        raise PointFileTruncated(
            "a last line that does not end",
            want="a newline at the end",
            fix="Copy the file again, or add a newline if it is whole.",
            where=f"byte {len(body)} of the points",
        )
    lines = body.split(b"\n") if _has_blank_lines(body) else None
    if lines is None:
        return body
    return b"".join(line + b"\n" for line in lines if line.strip())


def _has_blank_lines(body: bytes) -> bool:
    text = body.replace(b"\r", b"").replace(b" ", b"").replace(b"\t", b"")
    return b"\n\n" in text or text.startswith(b"\n") or not body.endswith(b"\n")


def line_ends(body: bytes) -> Int64:
    """Positions just behind each newline of `body`."""
    return np.flatnonzero(np.frombuffer(body, np.uint8) == _NEWLINE).astype(np.int64) + 1


def decode_table(body: bytes, dtypes: Sequence[Dtype], rows: int) -> list[AnyArray]:
    """The columns of `rows` lines of numbers, none of them blank.

    Args:
        body: text, ending with a newline (`without_blank_lines`).
        dtypes: of the columns.
        rows: lines wanted.

    Raises:
        PointFileTruncated: fewer lines.
        PointFileCorrupt: more lines, a line with another number of values, not numbers.
    """
    check_claim(SHORTEST_VALUE * rows * len(dtypes), len(body), items=rows, at_byte=0)
    _check_rows(body, len(dtypes), rows)
    _check_bytes(body)
    if not rows:
        return [np.zeros(0, dtype) for dtype in dtypes]
    table = _numbers(body, rows * len(dtypes)).reshape(rows, len(dtypes))
    return [_column(table[:, i], dtype, body, i, len(dtypes)) for i, dtype in enumerate(dtypes)]


def _check_rows(body: bytes, columns: int, rows: int) -> None:
    ends = line_ends(body)
    if len(ends) < rows:
        raise PointFileTruncated(f"{len(ends)} lines of points", want=f"{rows}")
    if len(ends) > rows:
        raise PointFileCorrupt(f"{len(ends)} lines of points", want=f"{rows} as the header says")
    inside = np.frombuffer(body, np.uint8) > _SPACE
    starts = inside.copy()
    starts[1:] &= ~inside[:-1]
    words = np.diff(np.searchsorted(np.flatnonzero(starts), ends), prepend=0)
    wrong = np.flatnonzero(words != columns)
    if wrong.size:
        raise PointFileCorrupt(
            f"{words[wrong[0]]} values", want=f"{columns}", where=f"line {wrong[0] + 1} of points"
        )


def _check_bytes(body: bytes) -> None:
    stray = body.translate(None, _NUMBER_BYTES)
    if stray:
        line = body.count(b"\n", 0, body.index(stray[:1])) + 1
        raise PointFileCorrupt(
            f"character {chr(stray[0])!r}", want="numbers", where=f"line {line} of points"
        )


def _numbers(body: bytes, count: int) -> Float64:
    try:
        values = np.fromstring(body, np.float64, sep=" ")
    except ValueError:
        values = np.zeros(0)
    if len(values) != count:
        raise PointFileCorrupt("a word among the points", want="numbers")
    return values


def _column(values: Float64, dtype: Dtype, body: bytes, index: int, columns: int) -> AnyArray:
    if dtype.kind == "f":
        with np.errstate(over="ignore"):
            return values.astype(dtype)
    limits = np.iinfo(dtype)
    whole = np.isfinite(values) & (np.floor(values) == values)
    if not np.all(whole & (values >= limits.min) & (values <= limits.max)):
        raise PointFileCorrupt(
            f"column {index + 1} of the points holds other than {dtype.name}",
            want=f"whole numbers from {limits.min} to {limits.max}",
        )
    if np.any(np.abs(values) >= _LARGEST_EXACT):
        return _exact(body.split()[index::columns], dtype)
    return values.astype(dtype)


def _exact(words: list[bytes], dtype: Dtype) -> AnyArray:
    try:
        return np.array([int(word) for word in words], dtype)
    except (ValueError, OverflowError) as error:
        raise PointFileCorrupt(
            "a number that does not fit", want=f"whole numbers of {dtype.name}"
        ) from error
