"""PLY meshes: the vertices are those of a PLY cloud, with faces behind them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import PointFileCorrupt, PseudolidarError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.meshes.faces import check_places, fans
from pseudolidar.formats.points.ply import decode_ply, encode_ply, ply_header
from pseudolidar.formats.points.ply_header import PlyElement, PlyHeader
from pseudolidar.formats.points.point_file import read_point_bytes
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.mesh import Mesh

_END = b"end_header\n"
_FACE_LISTS = ("vertex_indices", "vertex_index")
_FACE = np.dtype([("count", "u1"), ("vertices", "<i4", (3,))])


def write_ply_mesh(path: Path, mesh: Mesh) -> None:
    """Write a mesh with its colours and normals, binary.

    Raises:
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_ply_mesh(mesh))


def read_ply_mesh(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """Read the vertices and faces of a PLY of any encoding; faces become fans of triangles.

    Raises:
        PointFileMissing, PointFileTruncated, PointFileHeader, PointFileCorrupt, PointFileField,
        MeshIndex, LimitError: as `read_ply`, of a file without faces too.
    """
    try:
        return decode_ply_mesh(read_point_bytes(path), limits=limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def encode_ply_mesh(mesh: Mesh) -> bytes:
    """The bytes of a PLY with the elements `vertex` and `face`."""
    normals = (
        {} if mesh.normals is None else dict(zip(("nx", "ny", "nz"), mesh.normals.T, strict=True))
    )
    cloud = PointCloud(mesh.vertices, mesh.frame, rgb=mesh.rgb, extra=normals)
    head, _, vertices = encode_ply(cloud).partition(_END)
    faces = np.empty(len(mesh), _FACE)
    faces["count"], faces["vertices"] = 3, mesh.triangles
    element = f"element face {len(mesh)}\nproperty list uchar int vertex_indices\n".encode()
    return b"".join((head, element, _END, vertices, faces.tobytes()))


def decode_ply_mesh(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """The mesh in the bytes of a PLY; errors as in `read_ply_mesh`."""
    cloud = decode_ply(data, limits=limits)  # checks every element, faces too
    header = ply_header(data)
    if not any(e.name == "face" and e.count and e.properties for e in header.elements):
        raise PointFileCorrupt("no face", want="a mesh", fix="Read it as a cloud: it is points.")
    check_places(cloud.xyz)
    lists = _ascii_lists(data, header) if header.encoding == "ascii" else _lists(data, header)
    axes = [cloud.extra.get(name) for name in ("nx", "ny", "nz")]
    known = [axis.astype(np.float32) for axis in axes if axis is not None]
    normals = np.stack(known, axis=1) if len(known) == 3 else None
    return Mesh(cloud.xyz, fans(lists), cloud.frame, cloud.rgb, normals)


def _lists(data: bytes, header: PlyHeader) -> list[AnyArray]:
    """Vertex numbers of each face; the file was found whole before."""
    at = header.body_at
    for element in header.elements:
        if element.name == "face":
            return _faces(data, at, element)
        if element.has_lists:
            break
        at += element.count * element.smallest_bytes
    raise PointFileCorrupt(
        "lists before the faces", want="faces right behind the vertices", where=f"byte {at}"
    )


def _faces(data: bytes, at: int, element: PlyElement) -> list[AnyArray]:
    """All at once where every face is a triangle and nothing else, else one by one."""
    (p, *others) = element.properties
    if p.length is not None and not others:
        items = np.dtype([("count", p.length), ("vertices", p.dtype, (3,))])
        if items.itemsize * element.count <= len(data) - at:
            faces = np.frombuffer(data, items, element.count, at)
            if (faces["count"] == 3).all():
                return [faces["vertices"]]
    found = []
    for _ in range(element.count):
        for p in element.properties:
            length = 1
            if p.length is not None:
                length = int(np.frombuffer(data, p.length, 1, at)[0])
                at += p.length.itemsize
                if p.name in _FACE_LISTS:
                    found.append(np.frombuffer(data, p.dtype, length, at)[None])
            at += length * p.dtype.itemsize
    return found


def _ascii_lists(data: bytes, header: PlyHeader) -> list[AnyArray]:
    lines = [line for line in data[header.body_at :].split(b"\n") if line.strip()]
    elements = [e for e in header.elements if e.properties]
    names = [e.name for e in elements]
    first = sum(e.count for e in elements[: names.index("face")])
    face = elements[names.index("face")]
    found = []
    for line in lines[first : first + face.count]:
        words = [int(float(word)) for word in line.split()]
        at = 0
        for p in face.properties:
            length = 1 if p.length is None else 1 + words[at]
            if p.name in _FACE_LISTS:
                found.append(np.array(words[at + 1 : at + length])[None])
            at += length
    return found
