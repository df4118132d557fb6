"""PLY clouds: binary and ascii; faces and other elements are checked and left out."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import (
    PointFileCorrupt,
    PointFileField,
    PointFileTruncated,
    PseudolidarError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.points.ascii_table import (
    SHORTEST_VALUE,
    encode_table,
    line_ends,
    without_blank_lines,
)
from pseudolidar.formats.points.columns import Notes, assemble, notes_of, scalar_fields, storable
from pseudolidar.formats.points.ply_header import PlyElement, PlyHeader, PlyProperty, parse_header
from pseudolidar.formats.points.ply_items import Columns, ascii_items, binary_items
from pseudolidar.formats.points.point_file import (
    MAX_HEADER_BYTES,
    CloudFacts,
    Salvaged,
    check_claim,
    check_point_limit,
    read_point_bytes,
    refuse_other_content,
)
from pseudolidar.formats.points.records import interleave
from pseudolidar.structures.arrays import AnyArray, UInt8
from pseudolidar.structures.cloud import PointCloud

Encoding = Literal["binary_little_endian", "ascii"]
_COLOURS = ("red", "green", "blue")
# CloudCompare and MeshLab show properties of this name as scalar fields.
_SCALAR = "scalar_"
# Names that programs know without it.
_PLAIN = {"intensity", "nx", "ny", "nz", "alpha"}
# PLY has no 64-bit integers: such a column is written as two, by these endings.
_HIGH, _LOW = "_high32", "_low32"
_HALVES = {"int64": ("<i4", "<u4"), "uint64": ("<u4", "<u4")}


def write_ply(
    path: Path, cloud: PointCloud, *, encoding: Encoding = "binary_little_endian"
) -> None:
    """Write a cloud with all its columns.

    Raises:
        StructureError: an extra column that cannot be a property.
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_ply(cloud, encoding=encoding))


def read_ply(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    """Read the vertices of a PLY of any encoding.

    Frame, time and shape come from the comments that `write_ply` leaves; files of others are in
    frame "unknown" at time 0. Properties that are no column of clouds become extra ones, without
    the prefix `scalar_`. Lists of vertices are left out, and so are faces and other elements,
    which must be complete all the same.

    Raises:
        PointFileMissing, PointFileTruncated, PointFileHeader, PointFileCorrupt, PointFileField,
        LimitError: with the place in the file.
    """
    try:
        return decode_ply(read_point_bytes(path), limits=limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def encode_ply(cloud: PointCloud, *, encoding: Encoding = "binary_little_endian") -> bytes:
    """The bytes of a PLY with one element, `vertex`.

    Columns beyond position, colour, intensity and normals are named `scalar_NAME`; 64-bit integers
    become two properties, which `read_ply` joins.

    Raises:
        StructureError: an extra column that cannot be a property.
    """
    columns, dtypes = _table(cloud)
    header = _header(cloud, columns, dtypes, len(cloud), encoding)
    if encoding == "ascii":
        return header + encode_table(list(columns.values()))
    return b"".join((header, interleave(columns).data))


def encode_ply_pieces(clouds: Iterable[PointCloud], count: int) -> Generator[bytes]:
    """The bytes of one binary PLY, cloud by cloud, for more points than the memory holds.

    Args:
        clouds: alike but for their points; the frame and the time are those of the first.
        count: points of all of them together.

    Raises:
        StructureError: an extra column that cannot be a property.
    """
    for number, cloud in enumerate(clouds):
        columns, dtypes = _table(cloud)
        if number == 0:
            yield _header(cloud, columns, dtypes, count, "binary_little_endian")
        yield interleave(columns).tobytes()


def _table(cloud: PointCloud) -> tuple[dict[str, AnyArray], dict[str, str]]:
    """Properties by name, and dtypes of columns that PLY lacks."""
    scalars, dtypes = storable(scalar_fields(cloud))
    columns: dict[str, AnyArray] = {axis: cloud.xyz[:, i] for i, axis in enumerate("xyz")}
    if cloud.rgb is not None:
        columns |= {name: cloud.rgb[:, i] for i, name in enumerate(_COLOURS)}
    for name, column in scalars.items():
        title = name if name in _PLAIN else _SCALAR + name
        if column.dtype.name in _HALVES:
            dtypes[name] = column.dtype.name
            columns |= _halves(title, column)
        else:
            columns[title] = column
    return columns, dtypes


def _header(
    cloud: PointCloud,
    columns: Mapping[str, AnyArray],
    dtypes: Mapping[str, str],
    count: int,
    encoding: Encoding,
) -> bytes:
    properties = tuple(
        PlyProperty(name, column.dtype.newbyteorder("<")) for name, column in columns.items()
    )
    element = PlyElement("vertex", count, properties)
    return PlyHeader(encoding, (element,), notes_of(cloud, dtypes)).encode()


def decode_ply(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    """The cloud in the bytes of a PLY; errors as in `read_ply`."""
    return _cloud(data, ply_header(data), limits)


def ply_header(data: bytes) -> PlyHeader:
    """What the header at the start of `data` says.

    Raises:
        PointFileHeader: another kind of file, or an illegal line.
        PointFileTruncated: the file ends within it.
    """
    refuse_other_content(data, want="PLY", kinds=("PLY cloud",))
    return parse_header(data)


def ply_facts(path: Path) -> CloudFacts:
    """What the header of a PLY says; errors as in `ply_header`."""
    header = ply_header(read_point_bytes(path, most=MAX_HEADER_BYTES))
    vertices = [e for e in header.elements if e.name == "vertex"]
    count = vertices[0].count if vertices else 0
    columns = [
        (p.name, p.dtype.name if p.length is None else f"list of {p.dtype.name}")
        for p in (vertices[0].properties if vertices else ())
    ]
    others = tuple((e.name, e.count) for e in header.elements if e not in vertices)
    notes = header.notes
    frame, time_ns = notes.frame, notes.timestamp_ns
    return CloudFacts(count, tuple(columns), header.encoding, frame, time_ns, others=others)


def salvage_ply(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> Salvaged:
    """The whole vertices of a PLY that ends early; what follows them is left out.

    Raises:
        PointFileTruncated: what precedes the vertices is not whole, or they have lists.
        PseudolidarError: as `read_ply` of a whole file.
    """
    header = ply_header(data)
    names = [e.name for e in header.elements]
    place = names.index("vertex") if "vertex" in names else 0
    if names.count("vertex") != 1 or header.elements[place].has_lists:
        return Salvaged(_cloud(data, header, limits), 0)
    before, vertex = header.elements[:place], header.elements[place]
    if header.encoding == "ascii":
        body = data[header.body_at : max(header.body_at, data.rfind(b"\n") + 1)]
        lines = [line + b"\n" for line in body.split(b"\n") if line.strip()]
        first = sum(e.count for e in before if e.properties)
        whole = min(vertex.count, max(0, len(lines) - first))
        data = data[: header.body_at] + b"".join(lines[: first + whole])
    else:
        at = header.body_at
        for element in before:
            _, at = binary_items(data, at, element, vertices=vertex.count)
        size = max(1, vertex.smallest_bytes)
        whole = min(vertex.count, (len(data) - at) // size)
        data = data[: at + whole * size]
    part = replace(header, elements=(*before, replace(vertex, count=whole)))
    return Salvaged(_cloud(data, part, limits), vertex.count)


def _cloud(data: bytes, header: PlyHeader, limits: Limits) -> PointCloud:
    vertices = [e for e in header.elements if e.name == "vertex"]
    if len(vertices) != 1:
        raise PointFileField(
            f"{len(vertices)} elements 'vertex' among {[e.name for e in header.elements][:10]}",
            want="one with x, y and z",
        )
    _check_claims(data, header)
    check_point_limit(vertices[0].count, limits)
    read = _ascii if header.encoding == "ascii" else _binary
    columns = read(data, header, vertices[0].count)
    if len(next(iter(columns.values()), ())) != vertices[0].count:
        raise PointFileField("vertices without single values", want="x, y and z")
    rgb = _pop_colours(columns)
    return assemble(_named(columns, header.notes), rgb, header.notes, None)


def _check_claims(data: bytes, header: PlyHeader) -> None:
    text = header.encoding == "ascii"
    claimed = sum(
        e.count * (len(e.properties) * SHORTEST_VALUE if text else e.smallest_bytes)
        for e in header.elements
    )
    items = sum(e.count for e in header.elements)
    check_claim(claimed, len(data) - header.body_at, items=items, at_byte=header.body_at)


def _binary(data: bytes, header: PlyHeader, count: int) -> Columns:
    at, vertices = header.body_at, {}
    for element in header.elements:
        columns, at = binary_items(data, at, element, vertices=count)
        if element.name == "vertex":
            vertices = columns
    if at < len(data):
        raise PointFileCorrupt(
            f"{len(data) - at} bytes behind the last element",
            want="the end of the file",
            where=f"byte {at}",
        )
    return vertices


def _ascii(data: bytes, header: PlyHeader, count: int) -> Columns:
    elements = [e for e in header.elements if e.properties]
    body = without_blank_lines(data[header.body_at :])
    ends = np.concatenate([[0], line_ends(body)])
    first, vertices = 0, {}
    for element in elements:
        last = min(first + element.count, len(ends) - 1)
        if last - first < element.count:
            raise PointFileTruncated(
                f"{last - first} lines of {element.name!r}",
                want=f"{element.count}",
                fix="Copy or make the file again: it ends early.",
            )
        columns = ascii_items(body[ends[first] : ends[last]], element, vertices=count)
        if element.name == "vertex":
            vertices = columns
        first = last
    if ends[first] < len(body):
        raise PointFileCorrupt(
            f"{len(ends) - 1} lines of items", want=f"{first} as the header says"
        )
    return vertices


def _halves(title: str, column: AnyArray) -> dict[str, AnyArray]:
    high, low = _HALVES[column.dtype.name]
    pairs = np.ascontiguousarray(column, column.dtype.newbyteorder("<")).view("<u4")
    return {title + _HIGH: pairs[1::2].view(high), title + _LOW: pairs[0::2].view(low)}


def _pop_colours(columns: Columns) -> UInt8 | None:
    if not all(name in columns and columns[name].dtype == np.uint8 for name in _COLOURS):
        return None
    return np.stack([columns.pop(name) for name in _COLOURS], axis=1)


def _named(columns: Columns, notes: Notes) -> Columns:
    """The columns without prefix, 64-bit integers joined, in their order."""
    split = {name: dtype for name, dtype in notes.dtypes.items() if dtype in _HALVES}
    named: Columns = {}
    for title, column in columns.items():
        name = title.removeprefix(_SCALAR)
        whole, low = name.removesuffix(_HIGH), title.removesuffix(_HIGH) + _LOW
        halves = [column, columns.get(low, column[:0])]
        if whole in split and low in columns and all(h.dtype.itemsize == 4 for h in halves):
            named[whole] = _joined(column, columns[low], split[whole])
        elif name.removesuffix(_LOW) not in split:
            named[title if name in columns or name in named else name] = column
    return named


def _joined(high: AnyArray, low: AnyArray, dtype: str) -> AnyArray:
    pairs = np.empty((len(high), 2), "<u4")
    pairs[:, 0], pairs[:, 1] = low.view("<u4"), high.view("<u4")
    return pairs.view(dtype)[:, 0]
