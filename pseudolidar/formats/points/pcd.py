"""PCD v0.7, the point cloud file of PCL: ascii, binary, binary_compressed."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import PointFileCorrupt, PseudolidarError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.points.ascii_table import (
    SHORTEST_VALUE,
    decode_table,
    encode_table,
    without_blank_lines,
)
from pseudolidar.formats.points.columns import assemble, notes_of, scalar_fields, storable
from pseudolidar.formats.points.pcd_header import PADDING, PcdField, PcdHeader, parse_header
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

Encoding = Literal["binary", "binary_compressed", "ascii"]
_TYPES = {"f": "F", "i": "I", "u": "U"}
# Two sizes precede compressed points: compressed and expanded bytes, uint32.
_SIZES = np.dtype("<u4")
# A field holds colours where it has one of these names and 4 bytes B, G, R, alpha.
_COLOURS = ("rgb", "rgba")
# Normals as PCL names them; PLY, and columns here, say nx.
NORMALS = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
# Of LZF (`lzf.LARGEST_EXPANSION`, which is not imported here for the weight of numba).
_LARGEST_EXPANSION = 88


def write_pcd(path: Path, cloud: PointCloud, *, encoding: Encoding = "binary") -> None:
    """Write a cloud with all its columns.

    Raises:
        StructureError: an extra column that cannot be a field.
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_pcd(cloud, encoding=encoding))


def read_pcd(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    """Read a PCD of any encoding.

    Frame and time come from the comments that `write_pcd` leaves; files of others are in frame
    "unknown" at time 0. Fields that are no column of clouds become extra ones; values of a field
    with COUNT n become `name_0` to `name_(n-1)`.

    Raises:
        PointFileMissing, PointFileTruncated, PointFileHeader, PointFileCorrupt, PointFileField,
        LimitError: with the place in the file.
    """
    try:
        return decode_pcd(read_point_bytes(path), limits=limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def encode_pcd(cloud: PointCloud, *, encoding: Encoding = "binary") -> bytes:
    """The bytes of a PCD.

    Colours are the field `rgb`, 0x00RRGGBB: TYPE F holding these bits where the body is binary,
    which every PCL reads, and TYPE U in text, where a float's digits would destroy them. Shape,
    frame, time and dtypes that PCD lacks go into comments.

    Raises:
        StructureError: an extra column that cannot be a field.
    """
    columns, dtypes = _table(cloud, encoding)
    header = _header(cloud, columns, dtypes, cloud.shape or (1, len(cloud)), encoding)
    if encoding == "ascii":
        return header + encode_table(list(columns.values()))
    if encoding == "binary_compressed":
        return header + _compressed(columns)
    return b"".join((header, interleave(columns).data))


def encode_pcd_pieces(clouds: Iterable[PointCloud], count: int) -> Generator[bytes]:
    """The bytes of one binary PCD, cloud by cloud, for more points than the memory holds.

    Args:
        clouds: alike but for their points; the frame and the time are those of the first.
        count: points of all of them together.

    Raises:
        StructureError: an extra column that cannot be a field.
    """
    for number, cloud in enumerate(clouds):
        columns, dtypes = _table(cloud, "binary")
        if number == 0:
            yield _header(cloud, columns, dtypes, (1, count), "binary")
        yield interleave(columns).tobytes()


def _table(cloud: PointCloud, encoding: Encoding) -> tuple[dict[str, AnyArray], dict[str, str]]:
    """Fields by name, and dtypes of columns that PCD lacks."""
    scalars, dtypes = storable(scalar_fields(cloud))
    scalars = {_renamed(name, scalars, NORMALS): column for name, column in scalars.items()}
    columns: dict[str, AnyArray] = {axis: cloud.xyz[:, i] for i, axis in enumerate("xyz")}
    if cloud.rgb is not None:
        columns["rgb"] = _packed(cloud.rgb, "<u4" if encoding == "ascii" else "<f4")
    return columns | scalars, dtypes


def _header(
    cloud: PointCloud,
    columns: Mapping[str, AnyArray],
    dtypes: Mapping[str, str],
    shape: tuple[int, int],
    encoding: Encoding,
) -> bytes:
    fields = tuple(
        PcdField(name, _TYPES[column.dtype.kind], column.dtype.itemsize)
        for name, column in columns.items()
    )
    rows, width = shape
    return PcdHeader(fields, width, rows, encoding, notes_of(cloud, dtypes)).encode()


def decode_pcd(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    """The cloud in the bytes of a PCD; errors as in `read_pcd`."""
    return _cloud(data, pcd_header(data), limits)


def pcd_header(data: bytes) -> PcdHeader:
    """What the header at the start of `data` says.

    Raises:
        PointFileHeader: another kind of file, or an illegal line.
        PointFileTruncated: the file ends within it.
    """
    refuse_other_content(data, want="PCD", kinds=("PCD cloud",))
    return parse_header(data)


def pcd_facts(path: Path) -> CloudFacts:
    """What the header of a PCD says; errors as in `pcd_header`."""
    header = pcd_header(read_point_bytes(path, most=MAX_HEADER_BYTES))
    columns = tuple(
        (f.name, f.dtype.name if f.count == 1 else f"{f.dtype.name} x {f.count}")
        for f in header.fields
        if f.name != PADDING
    )
    shape = (header.height, header.width) if header.height > 1 else None
    frame, time_ns = header.notes.frame, header.notes.timestamp_ns
    return CloudFacts(header.points, columns, header.encoding, frame, time_ns, shape)


def salvage_pcd(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> Salvaged:
    """The whole points of a PCD that ends early; others are not made up.

    Compressed files hold no whole point before their end.

    Raises:
        PointFileTruncated: not even the header is whole, or the points are compressed.
        PseudolidarError: as `read_pcd` of a whole file.
    """
    header = pcd_header(data)
    if header.encoding == "ascii":
        data = data[: max(header.body_at, data.rfind(b"\n") + 1)]
        whole = sum(1 for line in data[header.body_at :].split(b"\n") if line.strip())
    elif header.encoding == "binary":
        whole = (len(data) - header.body_at) // header.record.itemsize
        data = data[: header.body_at + min(whole, header.points) * header.record.itemsize]
    else:
        return Salvaged(_cloud(data, header, limits), header.points)
    part = replace(header, width=min(whole, header.points), height=1)
    return Salvaged(_cloud(data, part, limits), header.points)


def _cloud(data: bytes, header: PcdHeader, limits: Limits) -> PointCloud:
    least = _least_bytes(header)
    check_claim(least, len(data) - header.body_at, items=header.points, at_byte=header.body_at)
    check_point_limit(header.points, limits)
    if header.encoding == "ascii":
        values = _ascii_values(data, header)
    elif header.encoding == "binary":
        values = _binary_values(data, header)
    else:
        values = _compressed_values(data, header)
    shape = (header.height, header.width) if header.height > 1 else None
    fields, rgb = _named(header, values)
    return assemble(fields, rgb, header.notes, shape)


def _least_bytes(header: PcdHeader) -> int:
    """Bytes that the points claimed need at least."""
    if header.encoding == "ascii":
        return header.points * sum(field.count for field in header.fields) * SHORTEST_VALUE
    expanded = header.points * sum(field.count * field.size for field in header.fields)
    if header.encoding == "binary":
        return expanded
    return 2 * _SIZES.itemsize + expanded // _LARGEST_EXPANSION


def _packed(rgb: UInt8, dtype: str) -> AnyArray:
    packed = np.zeros((len(rgb), 4), np.uint8)
    packed[:, :3] = rgb[:, ::-1]
    return packed.view(dtype)[:, 0]


def _compressed(columns: dict[str, AnyArray]) -> bytes:
    from pseudolidar.formats.points.lzf import compress

    parts = [
        np.ascontiguousarray(column, column.dtype.newbyteorder("<")) for column in columns.values()
    ]
    expanded = np.concatenate([part.view(np.uint8) for part in parts])
    stream = compress(expanded)
    return np.array([len(stream), len(expanded)], _SIZES).tobytes() + stream


def _ascii_values(data: bytes, header: PcdHeader) -> list[AnyArray]:
    """(N, count) values of each field."""
    dtypes = [field.dtype for field in header.fields for _ in range(field.count)]
    columns = decode_table(without_blank_lines(data[header.body_at :]), dtypes, header.points)
    values, at = [], 0
    for field in header.fields:
        values.append(np.stack(columns[at : at + field.count], axis=1))
        at += field.count
    return values


def _binary_values(data: bytes, header: PcdHeader) -> list[AnyArray]:
    claimed = header.points * header.record.itemsize
    _check_size(claimed, data, header.body_at, header)
    records = np.frombuffer(data, header.record, header.points, header.body_at)
    return [records[str(i)] for i in range(len(header.fields))]


def _compressed_values(data: bytes, header: PcdHeader) -> list[AnyArray]:
    from pseudolidar.formats.points.lzf import decompress

    at = header.body_at + 2 * _SIZES.itemsize
    packed, expanded = (int(n) for n in np.frombuffer(data, _SIZES, 2, header.body_at))
    claimed = header.points * header.record.itemsize
    if expanded != claimed:
        raise PointFileCorrupt(
            f"{expanded} expanded bytes",
            want=f"{claimed} for {header.points} points",
            where=f"byte {header.body_at + _SIZES.itemsize}",
        )
    _check_size(packed, data, at, header)
    block = decompress(np.frombuffer(data, np.uint8, packed, at), expanded)
    values, start = [], 0
    for field in header.fields:
        stop = start + header.points * field.count * field.size
        values.append(block[start:stop].view(field.dtype).reshape(header.points, field.count))
        start = stop
    return values


def _check_size(claimed: int, data: bytes, at: int, header: PcdHeader) -> None:
    """The body has exactly the claimed bytes."""
    check_claim(claimed, len(data) - at, items=header.points, at_byte=at)
    if at + claimed < len(data):
        raise PointFileCorrupt(
            f"{len(data) - at - claimed} bytes behind the last point",
            want="the end of the file",
            where=f"byte {at + claimed}",
        )


def _named(header: PcdHeader, values: list[AnyArray]) -> tuple[dict[str, AnyArray], UInt8 | None]:
    """(N,) fields by name without padding, and the colours (N, 3)."""
    named: dict[str, AnyArray] = {}
    rgb = None
    for field, column in zip(header.fields, values, strict=True):
        if field.name == PADDING:
            continue
        if field.count > 1:
            named |= {f"{field.name}_{i}": column[:, i].copy() for i in range(field.count)}
        elif rgb is None and field.name.lower() in _COLOURS and field.size == 4:
            unpacked = np.ascontiguousarray(column).view(np.uint8).reshape(-1, 4)
            rgb = unpacked[:, 2::-1].copy()
            if field.name.lower() == "rgba":
                named["alpha"] = unpacked[:, 3].copy()
        else:
            named[field.name] = column[:, 0].copy()
    own = {pcl: name for name, pcl in NORMALS.items()}
    return {_renamed(name, named, own): column for name, column in named.items()}, rgb


def _renamed(name: str, among: Collection[str], names: Mapping[str, str]) -> str:
    """The other name of a column, unless one of that name is there too."""
    other = names.get(name, name)
    return name if other in among else other
