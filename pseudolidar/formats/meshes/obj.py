"""Wavefront OBJ meshes, with a colour behind each vertex as MeshLab and Blender read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    PointFileCorrupt,
    PointFileField,
    PointFileTruncated,
    PseudolidarError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.meshes.faces import check_numbers, check_places, fans
from pseudolidar.formats.points.ascii_table import encode_table
from pseudolidar.formats.points.columns import UNKNOWN_FRAME
from pseudolidar.formats.points.point_file import check_point_limit, read_point_bytes
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.mesh import Mesh

# OBJ has no counts: ours are a comment, so that a file that was cut at a line is found out.
_COUNTS = b"# pseudolidar mesh: "


def write_obj(path: Path, mesh: Mesh) -> None:
    """Write vertices, colours (0-1) and normals as text.

    Raises:
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_obj(mesh))


def read_obj(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """Read vertices, their colours and faces; texture, materials and normals are left out.

    Raises:
        PointFileMissing: it cannot be read.
        PointFileTruncated: it ends within a line, or before the counts that `write_obj` gave it.
        PointFileCorrupt, PointFileField, MeshIndex: with the line or face.
        LimitError: more vertices than `limits` believes.
    """
    try:
        return decode_obj(read_point_bytes(path), limits=limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def encode_obj(mesh: Mesh) -> bytes:
    """The bytes of an OBJ file."""
    columns = list(mesh.vertices.T)
    if mesh.rgb is not None:
        columns += [np.round(c / 255.0, 4).astype(np.float32) for c in mesh.rgb.T]
    parts = [
        b"%s%d vertices, %d triangles, frame %s\n"
        % (_COUNTS, len(mesh.vertices), len(mesh), mesh.frame.encode()),
        _lines(b"v ", encode_table(columns)),
    ]
    numbers = [n + 1 for n in mesh.triangles.T]
    if mesh.normals is None:
        parts.append(_lines(b"f ", encode_table(numbers)))
    else:
        parts.append(_lines(b"vn ", encode_table(list(mesh.normals.T))))
        corner = b"%d//%d"
        row = b"f " + b" ".join([corner] * 3) + b"\n"
        doubled = np.repeat(np.stack(numbers, axis=1), 2, axis=1)
        parts.append((row * len(doubled)) % tuple(doubled.ravel().tolist()))
    return b"".join(parts)


def decode_obj(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """The mesh in the bytes of an OBJ file; errors as in `read_obj`."""
    if not data.endswith(b"\n"):
        raise PointFileTruncated(
            "a last line that does not end" if data else "an empty file",
            want="a newline at the end",
            where=f"byte {len(data)}",
        )
    rows: list[list[float]] = []
    faces: list[AnyArray] = []
    for number, line in enumerate(data.split(b"\n"), 1):
        if not line.startswith((b"v ", b"f ", b"v\t", b"f\t")):
            continue
        try:
            if line[:1] == b"v":
                rows.append([float(word) for word in line.split()[1:]])
            else:
                faces.append(_face(line, len(rows)))
        except (ValueError, OverflowError) as error:  # no number, or one of no vertex
            raise PointFileCorrupt(
                repr(line[:60])[1:], want="numbers", where=f"line {number}"
            ) from error
    check_point_limit(len(rows), limits)
    for face in faces:
        check_numbers(face, len(rows))
    vertices, colours = _vertices(rows)
    mesh = Mesh(vertices, fans(faces), _frame(data), colours)
    _check_counts(data, mesh)
    return mesh


def _lines(start: bytes, table: bytes) -> bytes:
    return start + table[:-1].replace(b"\n", b"\n" + start) + b"\n" if table else b""


def _face(line: bytes, vertices: int) -> AnyArray:
    """(1, corners) vertex numbers; negative ones count from the last vertex so far."""
    numbers = [int(word.partition(b"/")[0]) for word in line.split()[1:]]
    return np.array([[n - 1 if n > 0 else vertices + n if n else -1 for n in numbers]], np.int64)


def _vertices(rows: list[list[float]]) -> tuple[AnyArray, AnyArray | None]:
    lengths = {len(row) for row in rows}
    if not rows or len(lengths) != 1 or min(lengths) not in (3, 4, 6):
        raise PointFileField(
            f"vertices of {sorted(lengths)[:4]} values", want="x y z, with w or r g b behind them"
        )
    table = np.array(rows)
    vertices = table[:, :3]
    check_places(table)
    rgb = None
    if table.shape[1] == 6:
        rgb = np.rint(255 * np.clip(table[:, 3:], 0, 1)).astype(np.uint8)
    single = vertices.astype(np.float32)
    same = np.abs(single - vertices).max() <= 1e-7 * np.abs(vertices).max()
    return (single if same else vertices), rgb


def _frame(data: bytes) -> str:
    line = data[: data.index(b"\n")]
    if not line.startswith(_COUNTS):
        return UNKNOWN_FRAME
    return line.partition(b", frame ")[2].decode(errors="replace") or UNKNOWN_FRAME


def _check_counts(data: bytes, mesh: Mesh) -> None:
    line = data[: data.index(b"\n")]
    found = f"{len(mesh.vertices)} vertices, {len(mesh)} triangles"
    if line.startswith(_COUNTS) and not line[len(_COUNTS) :].startswith(found.encode() + b","):
        raise PointFileTruncated(found, want=line[len(_COUNTS) :].decode(errors="replace"))
