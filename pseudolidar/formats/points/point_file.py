"""Whole point files as bytes, and the checks that every reader of them makes first."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import (
    LimitError,
    PointFileHeader,
    PointFileMissing,
    PointFileTruncated,
)
from pseudolidar.formats.limits import Limits, raise_cap
from pseudolidar.formats.pictures.image_kinds import content_kind
from pseudolidar.formats.whole_read import read_whole
from pseudolidar.structures.cloud import PointCloud

# Longest text header that is believed, bytes; real ones are below 2 kB.
MAX_HEADER_BYTES = 64 * 1024
_COUNT = re.compile(r"[0-9]{1,18}")


@dataclass(frozen=True)
class CloudFacts:
    """What the header of a file of points says.

    Args:
        points: how many it claims.
        columns: name and dtype of each column, as the file has them.
        encoding: of the points.
        frame: coordinate frame, "" where it says none.
        timestamp_ns: time, 0 where it says none.
        shape: (rows, columns) of an organised cloud.
        others: what else is in the file, and how many: faces of a mesh.
    """

    points: int
    columns: tuple[tuple[str, str], ...]
    encoding: str
    frame: str = ""
    timestamp_ns: int = 0
    shape: tuple[int, int] | None = None
    others: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, eq=False)
class Salvaged:
    """What is whole of a file that ends early.

    Args:
        cloud: its whole points, in file order; not organised.
        claimed: points that the file should hold.
    """

    cloud: PointCloud
    claimed: int


def read_point_bytes(path: Path, *, most: int | None = None) -> bytes:
    """All bytes of a point file, or the first `most` of them.

    Raises:
        PointFileMissing: no such file, a folder, or no permission to read it.
    """
    try:
        if most is not None:
            with path.open("rb") as file:
                return file.read(most)
        return read_whole(path)
    except OSError as error:
        raise unreadable(path, error) from error


def unreadable(path: Path, error: OSError) -> PointFileMissing:
    """What it means that a file cannot be opened or read."""
    return PointFileMissing(error.strerror or str(error), want="a readable point file", path=path)


def refuse_other_content(data: bytes, *, want: str, kinds: tuple[str, ...]) -> None:
    """Raise where the content is clearly that of another format.

    Args:
        data: the file.
        want: name of the format.
        kinds: what `content_kind` calls it.

    Raises:
        PointFileTruncated: the file is empty.
        PointFileHeader: names what the content is.
    """
    if not data:
        raise PointFileTruncated("an empty file", want=f"a {want} file", where="byte 0")
    found = content_kind(data)
    if found and found not in (*kinds, "text file"):
        raise PointFileHeader(
            f"content that is a {found}",
            want=f"a {want} file, as its name says",
            fix="Give the file the extension of its content; --sniff reads clouds by it.",
            where="byte 0",
        )


def header_lines(data: bytes, *, last: str) -> Iterator[tuple[int, str, int]]:
    """Number (from 1), text and end in bytes of each complete line that is not blank.

    Args:
        data: the file.
        last: what the last line of the header starts with; the caller stops there.

    Raises:
        PointFileTruncated: the file ends before that line does.
        PointFileHeader: it does not come within `MAX_HEADER_BYTES`.
    """
    at, number = 0, 0
    while (newline := data.find(b"\n", at, MAX_HEADER_BYTES)) >= 0:
        number += 1
        text = data[at:newline].decode("utf-8", errors="replace").lstrip("\ufeff").strip()
        at = newline + 1
        if text:
            yield number, text, at
    want = f"a header up to its {last} line"
    if len(data) >= MAX_HEADER_BYTES:
        raise PointFileHeader(
            f"no {last} line within {MAX_HEADER_BYTES} bytes", want=want, where=f"line {number}"
        )
    raise PointFileTruncated(
        f"{len(data)} bytes and no complete {last} line",
        want=want,
        fix="Copy or make the file again: it ends early, or is of another format.",
        where=f"byte {len(data)}",
    )


def header_count(text: str, name: str, where: str) -> int:
    """A count of a header: plain decimal digits, nothing else.

    Raises:
        PointFileHeader: `text` is not one.
    """
    if not _COUNT.fullmatch(text):
        raise PointFileHeader(f"{name} {text[:40]!r}", want="a whole number >= 0", where=where)
    return int(text)


def check_point_limit(points: int, limits: Limits) -> None:
    """Raise `LimitError` where more points are claimed than `limits` believes."""
    if points > limits.points:
        raise LimitError(
            f"{points} points claimed",
            want=f"at most {limits.points}",
            fix=raise_cap("points"),
        )


def check_claim(claimed: int, available: int, *, items: int, at_byte: int) -> None:
    """Raise unless the `available` bytes hold the `claimed` ones, before any allocation.

    Args:
        claimed: bytes that the header's claims need at least.
        available: bytes from `at_byte` to the end of the file.
        items: points (or lines, faces) claimed.
        at_byte: where they begin.

    Raises:
        PointFileTruncated: with what is there and what was wanted.
    """
    if available < claimed:
        have = available * items // claimed
        raise PointFileTruncated(
            f"{available} bytes, enough for {have} of {items}",
            want=f"at least {claimed} bytes",
            fix="Copy or make the file again: it ends early.",
            where=f"byte {at_byte + available}",
        )
