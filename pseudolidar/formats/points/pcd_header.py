"""Header of PCD v0.7 files, written and parsed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import PointFileHeader
from pseudolidar.formats.points.columns import Notes, parse_notes
from pseudolidar.formats.points.point_file import header_count, header_lines

ENCODINGS = ("ascii", "binary", "binary_compressed")
PADDING = "_"
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_KEYWORDS = (
    "VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA",
)  # fmt: skip
_REQUIRED = ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT")
_VERSION = re.compile(r"0?\.[5-7]")
# Values of one point that are believed; the largest descriptor of PCL has 1980.
_MAX_VALUES = 10_000

Line = tuple[int, list[str]]


@dataclass(frozen=True)
class PcdField:
    """One field: `count` values of `size` bytes and `type` F, I or U."""

    name: str
    type: str
    size: int
    count: int = 1

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of one value."""
        return np.dtype(f"<{self.type.lower()}{self.size}")


@dataclass(frozen=True)
class PcdHeader:
    """What a header says.

    Args:
        fields: in file order, padding included.
        width: points of a row.
        height: rows, 1 where the cloud is not organised.
        encoding: one of `ENCODINGS`.
        notes: from our comment lines.
        body_at: byte where the points begin.
    """

    fields: tuple[PcdField, ...]
    width: int
    height: int
    encoding: str
    notes: Notes
    body_at: int = 0

    @property
    def points(self) -> int:
        """Number of points."""
        return self.width * self.height

    @property
    def record(self) -> np.dtype[Any]:
        """Structured dtype of a point; its fields have their position as name."""
        return np.dtype([(str(i), f.dtype, (f.count,)) for i, f in enumerate(self.fields)])

    def encode(self) -> bytes:
        """The header's lines."""
        fields = self.fields
        lines = ["# .PCD v0.7 - Point Cloud Data file format"]
        lines += [f"# {note}" for note in self.notes.lines()]
        lines += [
            "VERSION 0.7",
            "FIELDS " + " ".join(f.name for f in fields),
            "SIZE " + " ".join(str(f.size) for f in fields),
            "TYPE " + " ".join(f.type for f in fields),
            "COUNT " + " ".join(str(f.count) for f in fields),
            f"WIDTH {self.width}",
            f"HEIGHT {self.height}",
            "VIEWPOINT 0 0 0 1 0 0 0",
            f"POINTS {self.points}",
            f"DATA {self.encoding}\n",
        ]
        return "\n".join(lines).encode("ascii")


def parse_header(data: bytes) -> PcdHeader:
    """The header at the start of `data`.

    Raises:
        PointFileTruncated: the file ends within it.
        PointFileHeader: an illegal line, with its number and the legal values.
    """
    entries: dict[str, Line] = {}
    comments: list[str] = []
    for number, text, end in header_lines(data, last="DATA"):
        if text.startswith("#"):
            comments.append(text[1:])
            continue
        words = text.split()
        keyword = words[0].upper()
        keyword = "FIELDS" if keyword == "COLUMNS" else keyword
        if keyword not in _KEYWORDS or keyword in entries:
            known = keyword in entries
            raise PointFileHeader(
                f"a second {keyword}" if known else f"{text[:60]!r}",
                want=f"one each of {', '.join(_KEYWORDS)}",
                where=f"line {number}",
            )
        entries[keyword] = (number, words[1:])
        if keyword == "DATA":
            return _header(entries, parse_notes(comments), end)
    raise AssertionError("header_lines ends with an error")


def _header(entries: dict[str, Line], notes: Notes, body_at: int) -> PcdHeader:
    for keyword in _REQUIRED:
        if keyword not in entries:
            raise PointFileHeader(f"no {keyword} line", want=f"one each of {', '.join(_REQUIRED)}")
    _check_version(entries)
    fields = _fields(entries)
    width, height = (_single(entries, keyword) for keyword in ("WIDTH", "HEIGHT"))
    if "POINTS" in entries and _single(entries, "POINTS") != width * height:
        raise PointFileHeader(
            f"POINTS {_single(entries, 'POINTS')}",
            want=f"WIDTH x HEIGHT = {width} x {height} = {width * height}",
            where=_place(entries, "POINTS"),
        )
    encoding = " ".join(entries["DATA"][1]).lower()
    if encoding not in ENCODINGS:
        raise PointFileHeader(
            f"DATA {encoding[:40]!r}", want=" or ".join(ENCODINGS), where=_place(entries, "DATA")
        )
    return PcdHeader(fields, width, height, encoding, notes, body_at)


def _check_version(entries: dict[str, Line]) -> None:
    version = " ".join(entries.get("VERSION", (0, ["0.7"]))[1])
    if not _VERSION.fullmatch(version):
        raise PointFileHeader(
            f"VERSION {version[:40]!r}", want="0.7", where=_place(entries, "VERSION")
        )


def _fields(entries: dict[str, Line]) -> tuple[PcdField, ...]:
    names = entries["FIELDS"][1]
    entries.setdefault("COUNT", (0, ["1"] * len(names)))
    for keyword in ("SIZE", "TYPE", "COUNT"):
        if len(entries[keyword][1]) != len(names):
            raise PointFileHeader(
                f"{len(entries[keyword][1])} values of {keyword}",
                want=f"{len(names)}, one for each of FIELDS",
                where=_place(entries, keyword),
            )
    repeated = [n for i, n in enumerate(names) if n != PADDING and n in names[:i]]
    if repeated:
        raise PointFileHeader(
            f"field {repeated[0]!r} twice",
            want="different names",
            where=_place(entries, "FIELDS"),
        )
    fields = tuple(_field(entries, index, name) for index, name in enumerate(names))
    if sum(field.count for field in fields) > _MAX_VALUES:
        raise PointFileHeader(
            f"{sum(field.count for field in fields)} values of a point",
            want=f"at most {_MAX_VALUES}",
            where=_place(entries, "COUNT"),
        )
    return fields


def _field(entries: dict[str, Line], index: int, name: str) -> PcdField:
    kind = entries["TYPE"][1][index].upper()
    if kind not in _SIZES:
        raise PointFileHeader(
            f"TYPE {kind[:20]!r} of {name!r}", want="F, I or U", where=_place(entries, "TYPE")
        )
    where = _place(entries, "SIZE")
    size = header_count(entries["SIZE"][1][index], "SIZE", where)
    if size not in _SIZES[kind]:
        raise PointFileHeader(
            f"SIZE {size} of {name!r}, which has type {kind}",
            want=" or ".join(str(legal) for legal in _SIZES[kind]),
            where=where,
        )
    where = _place(entries, "COUNT")
    count = header_count(entries["COUNT"][1][index], "COUNT", where)
    if count < 1:
        raise PointFileHeader(f"COUNT {count} of {name!r}", want="1 or more", where=where)
    return PcdField(name, kind, size, count)


def _single(entries: dict[str, Line], keyword: str) -> int:
    return header_count(" ".join(entries[keyword][1]), keyword, _place(entries, keyword))


def _place(entries: dict[str, Line], keyword: str) -> str:
    return f"line {entries[keyword][0]}"
