"""Files of clouds with the same columns joined to one, of which never more than a part is held."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, TypeVar

from pseudolidar.errors import PointFileField, PointFileTruncated, PseudolidarError
from pseudolidar.formats.atomic import atomic_file
from pseudolidar.formats.points.npz import join_npz
from pseudolidar.formats.points.pcd import pcd_header
from pseudolidar.formats.points.ply import ply_header
from pseudolidar.formats.points.point_file import MAX_HEADER_BYTES, read_point_bytes, unreadable
from pseudolidar.formats.points.velodyne_bin import POINT_BYTES

# Bytes that are held while a file is copied.
PIECE_BYTES = 1 << 22

Header = TypeVar("Header")


def join_clouds(files: Sequence[Path], out: Path) -> None:
    """Write one file of all points, in order: the bytes that a writer gives for all of them.

    Args:
        files: at least one; binary PLY or PCD, NPZ, or `.bin`, as the writers here leave them, not
            organised, all with the same columns.
        out: of the same format.

    Raises:
        PointFileField: one has other columns than the first.
        PointFileMissing, PointFileTruncated, PointFileHeader, PointFileCorrupt: one cannot be read.
        OutputError: the disk is full or gone; then there is no such file.
    """
    with atomic_file(out) as file:
        JOINERS[out.suffix.lower()](files, file)


def _join_ply(files: Sequence[Path], out: BinaryIO) -> None:
    headers = [_header(file, ply_header) for file in files]
    first = headers[0].elements[0]
    for file, header in zip(files, headers, strict=True):
        _check_same(file, header.elements[0].properties == first.properties)
    counts = [header.elements[0].count for header in headers]
    out.write(replace(headers[0], elements=(replace(first, count=sum(counts)),)).encode())
    for file, header, count in zip(files, headers, counts, strict=True):
        _copy(file, header.body_at, count * first.smallest_bytes, out)


def _join_pcd(files: Sequence[Path], out: BinaryIO) -> None:
    headers = [_header(file, pcd_header) for file in files]
    for file, header in zip(files, headers, strict=True):
        _check_same(file, header.fields == headers[0].fields)
    count = sum(header.width for header in headers)
    out.write(replace(headers[0], width=count).encode())
    for file, header in zip(files, headers, strict=True):
        _copy(file, header.body_at, header.points * header.record.itemsize, out)


def _join_bin(files: Sequence[Path], out: BinaryIO) -> None:
    """That a file is cut behind a whole point is not known: the format has no count."""
    for file in files:
        try:
            size = file.stat().st_size
        except OSError as error:
            raise unreadable(file, error) from error
        _copy(file, 0, math.ceil(size / POINT_BYTES) * POINT_BYTES, out)


def _join_npz(files: Sequence[Path], out: BinaryIO) -> None:
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        join_npz(files, archive)


def _check_same(file: Path, same: bool) -> None:
    if not same:
        raise PointFileField("other columns", want="those of the first file", path=file)


def _header(path: Path, parse: Callable[[bytes], Header]) -> Header:
    try:
        return parse(read_point_bytes(path, most=MAX_HEADER_BYTES))
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def _copy(path: Path, begin: int, size: int, out: BinaryIO) -> None:
    """All of so many bytes of a file."""
    copied = 0
    for piece in _pieces(path, begin, size):
        out.write(piece)
        copied += len(piece)
    if copied != size:
        raise PointFileTruncated(f"{copied} bytes of points", want=f"{size} bytes", path=path)


def _pieces(path: Path, begin: int, size: int) -> Iterator[bytes]:
    try:
        with path.open("rb") as file:
            file.seek(begin)
            while piece := file.read(min(PIECE_BYTES, size)):
                size -= len(piece)
                yield piece
    except OSError as error:
        raise unreadable(path, error) from error


JOINERS: Mapping[str, Callable[[Sequence[Path], BinaryIO], None]] = {
    ".ply": _join_ply,
    ".pcd": _join_pcd,
    ".npz": _join_npz,
    ".bin": _join_bin,
}
