"""Clouds as NumPy archives: one array a column, under the noun's own names."""

from __future__ import annotations

import io
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from pseudolidar.errors import (
    LimitError,
    PointFileCorrupt,
    PointFileField,
    PointFileMissing,
    PointFileTruncated,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.points.columns import UNKNOWN_FRAME, check_extras, fit_names
from pseudolidar.formats.points.point_file import (
    CloudFacts,
    check_point_limit,
    read_point_bytes,
    refuse_other_content,
)
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud

# Compressed archives of others are believed up to this ratio; ours are not compressed.
LARGEST_EXPANSION = 100
_FACTS = ("frame", "timestamp_ns", "shape", "columns")
_COLUMNS = ("xyz", "rgb", "intensity", "sigma_m", "uv")
_OPEN3D = {"positions": "xyz", "colors": "rgb"}
NORMALS = ("nx", "ny", "nz")
_SUFFIX = ".npy"
# Fixed time of every member, so that the same cloud gives the same bytes; the oldest of ZIP.
_MEMBER_TIME = (1980, 1, 1, 0, 0, 0)
_LONGEST_ARRAY_HEADER = 10_000  # characters, NumPy's own cap
# What zipfile and NumPy's header parser raise on damaged bytes.
_BROKEN = (
    zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError, EOFError, ValueError,
    TypeError, SyntaxError, OSError, RuntimeError, LookupError, MemoryError,
)  # fmt: skip


def write_npz(path: Path, cloud: PointCloud) -> None:
    """Write a cloud with all its columns; `numpy.load` reads it without pickle.

    Raises:
        StructureError: an extra column that is not numbers, or has a taken name.
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_npz(cloud))


def read_npz(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    """Read an archive with at least `xyz` (N, 3); further arrays of length N are columns.

    Archives of Open3D (`positions`, `colors`) are read too; what cannot stand in the name of a
    column becomes `_`. Pickled objects are never loaded.

    Raises:
        PointFileMissing, PointFileTruncated, PointFileCorrupt, PointFileField, LimitError: with
        the array concerned.
    """
    try:
        return decode_npz(read_point_bytes(path), limits=limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def read_npz_time(path: Path) -> int:
    """The time that an archive notes, without reading its points; 0 where it notes none.

    Raises:
        PointFileMissing: no such file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            member = archive.getinfo("timestamp_ns" + _SUFFIX)
            if member.file_size > _LONGEST_ARRAY_HEADER:
                return 0
            with archive.open(member) as file:
                time_ns = np.lib.format.read_array(file, allow_pickle=False).tolist()
    except FileNotFoundError as error:
        raise PointFileMissing("no such file", want="a point file", path=path) from error
    except _BROKEN:
        return 0  # what is wrong is told when the points are read
    return time_ns if isinstance(time_ns, int) else 0


def npz_facts(path: Path) -> CloudFacts:
    """The columns of a cloud by their headers.

    Raises:
        PointFileMissing, PointFileCorrupt: it cannot be read.
    """
    arrays = npz_arrays(path)
    columns = tuple(
        (name, f"{dtype}{f' x {shape[1]}' if len(shape) > 1 else ''}")
        for name, (dtype, shape) in arrays.items()
        if name not in _FACTS
    )
    _, shape = arrays.get("xyz", ("", ()))
    return CloudFacts(shape[0] if shape else 0, columns, "npz", "", read_npz_time(path))


def npz_arrays(path: Path) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Type and shape of each array of any archive by its header; no value is read.

    Raises:
        PointFileMissing, PointFileCorrupt: it cannot be read.
    """
    found: dict[str, tuple[str, tuple[int, ...]]] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                with archive.open(member) as file:
                    shape, _, dtype = _array_header(file)
                found[member.filename.removesuffix(_SUFFIX)] = dtype.name, shape
    except FileNotFoundError as error:
        raise PointFileMissing("no such file", want="an NPZ", path=path) from error
    except _BROKEN as error:
        raise PointFileCorrupt("a damaged archive", want="an NPZ", path=path) from error
    return found


def encode_npz(cloud: PointCloud) -> bytes:
    """The bytes of an uncompressed archive.

    Raises:
        StructureError: an extra column that is not numbers, or has a taken name.
    """
    check_extras(cloud)
    taken = [name for name in cloud.extra if name in _FACTS]
    if taken:
        raise StructureError(f"extra column {taken[0]!r}", want="another name", where="PointCloud")
    own = {name: getattr(cloud, name) for name in _COLUMNS if getattr(cloud, name) is not None}
    arrays: dict[str, AnyArray] = {
        **own,
        **cloud.extra,
        "frame": np.array(cloud.frame),
        "timestamp_ns": np.array(cloud.timestamp_ns, np.int64),
        "columns": np.array(list(own)),
    }
    if cloud.shape is not None:
        arrays["shape"] = np.array(cloud.shape, np.int64)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        for name, array in arrays.items():
            member = zipfile.ZipInfo(name + _SUFFIX, _MEMBER_TIME)
            with archive.open(member, "w", force_zip64=True) as file:
                plain = np.asarray(array, order="C")
                np.lib.format.write_array(file, plain, allow_pickle=False)
    return buffer.getvalue()


def join_npz(files: Sequence[Path], archive: zipfile.ZipFile) -> None:
    """Put the columns of archives that `write_npz` made one behind the other, one at a time.

    Args:
        files: at least one, with the same columns, not organised.
        archive: open for writing.

    Raises:
        PointFileField: one has other columns than the first.
        PointFileMissing, PointFileCorrupt: one cannot be read.
    """
    every = [npz_arrays(file) for file in files]
    for file, arrays in zip(files, every, strict=True):
        if {name: (kind, shape[1:]) for name, (kind, shape) in arrays.items()} != {
            name: (kind, shape[1:]) for name, (kind, shape) in every[0].items()
        }:
            raise PointFileField("other columns", want="those of the first file", path=file)
    for name in every[0]:
        parts = files[:1] if name in _FACTS else files
        count = sum(arrays[name][1][0] for arrays in every) if name not in _FACTS else None
        with archive.open(
            zipfile.ZipInfo(name + _SUFFIX, _MEMBER_TIME), "w", force_zip64=True
        ) as out:
            for number, file in enumerate(parts):
                array = _array_of(file, name)
                if number == 0:
                    facts = np.lib.format.header_data_from_array_1_0(array)
                    shape = array.shape if count is None else (count, *array.shape[1:])
                    np.lib.format.write_array_header_1_0(out, {**facts, "shape": shape})
                out.write(array.tobytes())


def _array_of(path: Path, name: str) -> AnyArray:
    """One array of an archive."""
    with zipfile.ZipFile(path) as archive:
        return _array(archive, archive.getinfo(name + _SUFFIX), DEFAULT_LIMITS)


def decode_npz(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    """The cloud in the bytes of an archive; errors as in `read_npz`."""
    refuse_other_content(data, want="NPZ", kinds=("ZIP archive",))
    arrays = _arrays(data, limits)
    if "xyz" not in arrays:
        arrays = _of_open3d(arrays)
    if "xyz" not in arrays:
        raise PointFileField(f"arrays {', '.join(arrays)[:200] or 'none'}", want="xyz (N, 3)")
    arrays = fit_names(arrays.items())
    frame, timestamp_ns, shape, columns = _facts(arrays)
    own = {name: arrays.pop(name) for name in _COLUMNS if name in arrays and name in columns}
    wrong = [name for name, array in arrays.items() if array.ndim != 1 or array.dtype.kind == "U"]
    if wrong:
        raise PointFileCorrupt(f"array {wrong[0]!r} of shape {arrays[wrong[0]].shape}", want="(N,)")
    try:
        return PointCloud(frame=frame, timestamp_ns=timestamp_ns, shape=shape, extra=arrays, **own)
    except StructureError as error:
        raise PointFileCorrupt(error.got, want=error.want, where=error.where) from error


def _of_open3d(arrays: dict[str, AnyArray]) -> dict[str, AnyArray]:
    """Arrays of Open3D's tensor clouds under our names; its columns are (N, 1)."""
    named = {_OPEN3D.get(name, name): array for name, array in arrays.items()}
    flat = {
        name: array[:, 0] if array.ndim == 2 and array.shape[1] == 1 else array
        for name, array in named.items()
    }
    colours = flat.get("rgb")
    if colours is not None and colours.dtype.kind == "f":  # 0 to 1
        flat["rgb"] = np.rint(np.clip(np.nan_to_num(colours), 0, 1) * 255).astype(np.uint8)
    normals = flat.get("normals")
    if normals is not None and normals.ndim == 2 and normals.shape[1] == 3:
        del flat["normals"]
        flat |= dict(zip(NORMALS, normals.T, strict=True))
    return flat


def _facts(
    arrays: dict[str, AnyArray],
) -> tuple[str, int, tuple[int, int] | None, Sequence[str]]:
    """Frame, time, shape and which arrays are the noun's own, taken out of `arrays`."""
    frame, time, shape, columns = (
        arrays.pop(name).tolist() if name in arrays else None for name in _FACTS
    )
    known = isinstance(frame, str | None) and isinstance(time, int | None)
    if known and isinstance(columns, list | None):
        match shape:
            case None:
                return frame or UNKNOWN_FRAME, time or 0, None, columns or _COLUMNS
            case [int(rows), int(cols)] if min(rows, cols) >= 0:
                return frame or UNKNOWN_FRAME, time or 0, (rows, cols), columns or _COLUMNS
    raise PointFileCorrupt(
        f"frame, time, shape {str([frame, time, shape])[:80]}",
        want="a text, a whole number, two whole numbers",
    )


def _arrays(data: bytes, limits: Limits) -> dict[str, AnyArray]:
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except _BROKEN as error:
        raise PointFileTruncated(
            f"{len(data)} bytes without an archive's end",
            want="a complete NPZ",
            fix="Copy or make the file again: it ends early.",
            where=f"byte {len(data)}",
        ) from error
    with archive:
        members = archive.infolist()
        claimed = sum(member.file_size for member in members)
        if claimed > len(data) * LARGEST_EXPANSION:
            raise LimitError(
                f"{claimed} bytes claimed by an archive of {len(data)}",
                want=f"at most {LARGEST_EXPANSION} times its size",
            )
        return {m.filename.removesuffix(_SUFFIX): _array(archive, m, limits) for m in members}


def _array_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    read = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}
    shape, fortran, dtype = read[version[0]](file, _LONGEST_ARRAY_HEADER)
    return shape, fortran, dtype


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, limits: Limits) -> AnyArray:
    where = f"array {member.filename[:80]!r}"
    try:
        with archive.open(member) as file:
            shape, fortran, dtype = _array_header(file)
            body = file.read()
    except _BROKEN as error:
        raise PointFileCorrupt(
            "a damaged member", want="a NumPy array", fix="Make the file again.", where=where
        ) from error
    if dtype.hasobject or dtype.kind not in "biufU" or fortran:
        raise PointFileCorrupt(f"{dtype} values", want="plain numbers, row by row", where=where)
    check_point_limit(shape[0] if shape else 0, limits)
    count = math.prod(shape)
    if min(shape, default=0) < 0 or len(body) != count * dtype.itemsize:
        raise PointFileCorrupt(f"{len(body)} bytes", want=f"{count} values of {dtype}", where=where)
    return np.frombuffer(body, dtype).reshape(shape).astype(dtype.newbyteorder("="))
