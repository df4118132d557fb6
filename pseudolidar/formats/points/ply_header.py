"""Header of PLY files, written and parsed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import PointFileHeader
from pseudolidar.formats.points.ascii_table import Dtype
from pseudolidar.formats.points.columns import Notes, parse_notes
from pseudolidar.formats.points.point_file import header_count, header_lines

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
# The name that every reader knows of each type that PLY has.
NAMES = {dtype: name for name, dtype in reversed(TYPES.items()) if not name[-1].isdigit()}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_WANT = "ply, format, comment, obj_info, element, property or end_header"


@dataclass(frozen=True)
class PlyProperty:
    """One property; `length` is the dtype of a list's length, None for a single value."""

    name: str
    dtype: Dtype
    length: Dtype | None = None


@dataclass(frozen=True)
class PlyElement:
    """`count` items with the same properties."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...] = ()

    @property
    def has_lists(self) -> bool:
        """Whether items differ in size."""
        return any(p.length is not None for p in self.properties)

    @property
    def smallest_bytes(self) -> int:
        """Least bytes of a binary item: empty lists."""
        return sum((p.length or p.dtype).itemsize for p in self.properties)


@dataclass(frozen=True)
class PlyHeader:
    """What a header says.

    Args:
        encoding: `ascii`, `binary_little_endian` or `binary_big_endian`.
        elements: in file order.
        notes: from our comment lines.
        body_at: byte where the items begin.
    """

    encoding: str
    elements: tuple[PlyElement, ...]
    notes: Notes
    body_at: int = 0

    def encode(self) -> bytes:
        """The header's lines."""
        lines = ["ply", f"format {self.encoding} 1.0"]
        lines += [f"comment {note}" for note in self.notes.lines()]
        for element in self.elements:
            lines.append(f"element {element.name} {element.count}")
            lines += [f"property {NAMES[p.dtype.str[1:]]} {p.name}" for p in element.properties]
        return ("\n".join(lines) + "\nend_header\n").encode("ascii")


def parse_header(data: bytes) -> PlyHeader:
    """The header at the start of `data`.

    Raises:
        PointFileTruncated: the file ends within it.
        PointFileHeader: an illegal line, with its number and the legal values.
    """
    encoding = ""
    elements: list[PlyElement] = []
    comments: list[str] = []
    for number, text, end in header_lines(data, last="end_header"):
        words = text.split()
        where = f"line {number}"
        match words:
            case ["ply"] if number == 1:
                pass
            case _ if number == 1:
                raise PointFileHeader(f"{' '.join(words)[:40]!r}", want="ply", where=where)
            case ["comment" | "obj_info", *rest]:
                comments.append(" ".join(rest))
            case ["format", name, "1.0"] if name in _BYTE_ORDERS and not encoding:
                encoding = name
            case ["element", name, count]:
                elements.append(PlyElement(name, header_count(count, f"count of {name}", where)))
            case ["property", *rest] if elements and encoding:
                elements[-1] = _with(elements[-1], _property(rest, _BYTE_ORDERS[encoding], where))
            case ["end_header"] if encoding:
                return PlyHeader(encoding, tuple(elements), parse_notes(comments), end)
            case _:
                raise PointFileHeader(
                    f"{' '.join(words)[:60]!r}",
                    want=f"{_WANT}; format {', '.join(_BYTE_ORDERS)} 1.0 once and first",
                    where=where,
                )
    raise AssertionError("header_lines ends with an error")


def _property(words: list[str], order: str, where: str) -> PlyProperty:
    match words:
        case ["list", length, kind, name] if TYPES.get(length, "f")[0] != "f" and kind in TYPES:
            return PlyProperty(name, np.dtype(order + TYPES[kind]), np.dtype(order + TYPES[length]))
        case [kind, name] if kind in TYPES:
            return PlyProperty(name, np.dtype(order + TYPES[kind]))
    raise PointFileHeader(
        f"property {' '.join(words)[:60]!r}",
        want=f"[list LENGTH-TYPE] TYPE NAME; types {', '.join(TYPES)}",
        where=where,
    )


def _with(element: PlyElement, added: PlyProperty) -> PlyElement:
    if any(p.name == added.name for p in element.properties):
        raise PointFileHeader(
            f"property {added.name!r} of {element.name!r} twice", want="different names"
        )
    return replace(element, properties=(*element.properties, added))
