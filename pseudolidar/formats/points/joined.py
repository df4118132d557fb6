"""Files of clouds with the same columns joined to one, of which never more than a part is held."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from pseudolidar.errors import PointFileField
from pseudolidar.formats.atomic import atomic_file
from pseudolidar.formats.points.npz import join_npz
from pseudolidar.formats.points.pcd import pcd_header
from pseudolidar.formats.points.ply import ply_header
from pseudolidar.formats.points.point_file import MAX_HEADER_BYTES, read_point_bytes

# Bytes that are held while a file is copied.
PIECE_BYTES = 1 << 22


def join_clouds(files: Sequence[Path], out: Path) -> None:
    """Write one file of all points, in order: the bytes that a writer gives for all of them.

    Args:
        files: at least one; binary PLY or PCD, NPZ, or `.bin`, as the writers here leave them, not
            organised, all with the same columns.
        out: of the same format.

    Raises:
        PointFileField: one has other columns than the first.
        PointFileMissing, PointFileTruncated, PointFileHeader: one cannot be read.
        OutputError: the disk is full or gone; then there is no such file.
    """
    with atomic_file(out) as file:
        JOINERS[out.suffix.lower()](files, file)


def _join_ply(files: Sequence[Path], out: BinaryIO) -> None:
    headers = [ply_header(read_point_bytes(file, most=MAX_HEADER_BYTES)) for file in files]
    first = headers[0].elements[0]
    for file, header in zip(files, headers, strict=True):
        _check_same(file, header.elements[0].properties == first.properties)
    count = sum(header.elements[0].count for header in headers)
    out.write(replace(headers[0], elements=(replace(first, count=count),)).encode())
    _copy(files, [header.body_at for header in headers], out)


def _join_pcd(files: Sequence[Path], out: BinaryIO) -> None:
    headers = [pcd_header(read_point_bytes(file, most=MAX_HEADER_BYTES)) for file in files]
    for file, header in zip(files, headers, strict=True):
        _check_same(file, header.fields == headers[0].fields)
    count = sum(header.width for header in headers)
    out.write(replace(headers[0], width=count).encode())
    _copy(files, [header.body_at for header in headers], out)


def _join_bin(files: Sequence[Path], out: BinaryIO) -> None:
    _copy(files, [0] * len(files), out)


def _join_npz(files: Sequence[Path], out: BinaryIO) -> None:
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        join_npz(files, archive)


def _check_same(file: Path, same: bool) -> None:
    if not same:
        raise PointFileField("other columns", want="those of the first file", path=file)


def _copy(files: Sequence[Path], begins: Sequence[int], out: BinaryIO) -> None:
    for path, begin in zip(files, begins, strict=True):
        for piece in _pieces(path, begin):
            out.write(piece)


def _pieces(path: Path, begin: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        file.seek(begin)
        while piece := file.read(PIECE_BYTES):
            yield piece


JOINERS: Mapping[str, Callable[[Sequence[Path], BinaryIO], None]] = {
    ".ply": _join_ply,
    ".pcd": _join_pcd,
    ".npz": _join_npz,
    ".bin": _join_bin,
}
