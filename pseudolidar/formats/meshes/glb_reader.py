"""glTF binary meshes read back: triangles, colours and the places of their nodes."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import (
    PointFileCorrupt,
    PointFileField,
    PointFileHeader,
    PointFileTruncated,
    PseudolidarError,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.meshes import glb
from pseudolidar.formats.meshes.faces import check_numbers, check_places
from pseudolidar.formats.points.columns import UNKNOWN_FRAME
from pseudolidar.formats.points.point_file import check_point_limit, read_point_bytes
from pseudolidar.geometry.quaternion import rotation_of
from pseudolidar.structures.arrays import AnyArray, Float64, UInt8
from pseudolidar.structures.mesh import Mesh

_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_DEEPEST = 64  # nodes within nodes


def read_glb(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """Read all triangles of the scene with the colours of their vertices, z up.

    Textures, materials, skins and animations are left out.

    Raises:
        PointFileMissing: it cannot be read.
        PointFileTruncated: it is shorter than its header or an accessor says.
        PointFileHeader: not GLB 2.
        PointFileCorrupt, PointFileField, MeshIndex: a document that contradicts itself, or has no
            triangles, or packs them by an extension.
        LimitError: more vertices than `limits` believes.
    """
    try:
        return decode_glb(read_point_bytes(path), limits=limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def decode_glb(data: bytes, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """The mesh in the bytes of a GLB; errors as in `read_glb`."""
    document, body = _chunks(data)
    try:
        packed = [e for e in document.get("extensionsRequired", ()) if "mesh" in e.lower()]
        if packed:
            raise PointFileField(f"packed by {packed}", want="plain accessors")
        pieces = [
            _primitive(document, body, primitive, T, limits)
            for number, T in _placed_meshes(document)
            for primitive in document["meshes"][number]["primitives"]
            if primitive.get("mode", glb.TRIANGLES) == glb.TRIANGLES
        ]
        frame = _frame(document)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise PointFileCorrupt(
            f"a document without what it refers to ({type(error).__name__}: {error})",
            want="glTF 2.0",
            where="JSON chunk",
        ) from error
    if not pieces:
        raise PointFileField("no triangles", want="a mesh in the scene")
    return _joined(pieces, frame)


def _chunks(data: bytes) -> tuple[dict[str, Any], memoryview]:
    if data[:4] != glb.MAGIC[: len(data[:4])] or not data:
        raise PointFileHeader(f"{data[:4]!r}", want="glTF binary", where="byte 0")
    if len(data) < 20:
        raise PointFileTruncated(f"{len(data)} bytes", want="a GLB header", where="byte 0")
    version, length, text_bytes, kind = struct.unpack_from("<III4s", data, 4)
    if version != glb.VERSION or kind != glb.JSON_CHUNK:
        raise PointFileHeader(f"version {version}, chunk {kind!r}", want="version 2, chunk JSON")
    if len(data) < length or 20 + text_bytes > length:
        raise PointFileTruncated(f"{len(data)} bytes", want=f"{length}", where=f"byte {len(data)}")
    try:
        document = json.loads(data[20 : 20 + text_bytes])
    except (ValueError, RecursionError) as error:
        raise PointFileCorrupt("text that is no JSON", where="JSON chunk") from error
    if not isinstance(document, dict):
        raise PointFileCorrupt("no object", want="glTF 2.0", where="JSON chunk")
    at = 20 + text_bytes
    body = memoryview(data)[at + 8 : length]
    if body:
        size, kind = struct.unpack_from("<I4s", data, at)
        if kind != glb.BIN_CHUNK or size > len(body):
            raise PointFileTruncated(f"{len(body)} bytes", want=f"{size}", where=f"byte {at}")
    return document, body


def _placed_meshes(document: dict[str, Any]) -> Iterator[tuple[int, Float64]]:
    """Number and place (4, 4) of each mesh of the scene, z up."""
    T_up = np.eye(4)
    T_up[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    scene = document["scenes"][document.get("scene", 0)]
    waiting = [(number, T_up, 0) for number in scene.get("nodes", ())]
    while waiting:
        number, T, depth = waiting.pop()
        if depth > _DEEPEST:
            raise PointFileCorrupt(f"nodes more than {_DEEPEST} deep", want="a tree of nodes")
        node = document["nodes"][number]
        T = T @ _place(node)
        waiting += [(child, T, depth + 1) for child in node.get("children", ())]
        if "mesh" in node:
            yield node["mesh"], T


def _place(node: dict[str, Any]) -> Float64:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    T = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    T[:3, :3] = rotation_of(np.array([w, x, y, z])) * np.array(node.get("scale", (1, 1, 1)))
    T[:3, 3] = node.get("translation", (0, 0, 0))
    return T


def _primitive(
    document: dict[str, Any],
    body: memoryview,
    primitive: dict[str, Any],
    T: Float64,
    limits: Limits,
) -> tuple[Float64, AnyArray, UInt8 | None]:
    """Vertices in the scene, triangles and colours."""
    attributes = primitive["attributes"]
    check_point_limit(document["accessors"][attributes["POSITION"]]["count"], limits)
    vertices = _accessor(document, body, attributes["POSITION"]).astype(np.float64)
    vertices = vertices @ T[:3, :3].T + T[:3, 3]
    if "indices" in primitive:
        numbers = _accessor(document, body, primitive["indices"]).ravel().astype(np.int64)
    else:
        numbers = np.arange(len(vertices))
    triangles = numbers[: len(numbers) // 3 * 3].reshape(-1, 3)
    check_numbers(triangles, len(vertices))
    if "COLOR_0" not in attributes:
        return vertices, triangles, None
    colours = _accessor(document, body, attributes["COLOR_0"])[:, :3]
    whole = np.iinfo(colours.dtype).max if colours.dtype.kind == "u" else 1.0
    return vertices, triangles, _srgb(colours / whole)


def _accessor(document: dict[str, Any], body: memoryview, number: int) -> AnyArray:
    accessor = document["accessors"][number]
    view = document["bufferViews"][accessor["bufferView"]]
    dtype, width = np.dtype(_DTYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
    row = dtype.itemsize * width
    stride, count = view.get("byteStride", row), accessor["count"]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    end = start + stride * (count - 1) + row
    if start < 0 or count < 1 or not row <= stride <= 252 + row or "sparse" in accessor:
        raise PointFileCorrupt(f"accessor {accessor}", want="plain values", where="JSON chunk")
    if end > len(body):
        raise PointFileTruncated(
            f"{len(body)} bytes of data", want=f"{end}", where=f"accessor {number}"
        )
    raw = np.frombuffer(body[start:end], np.uint8)
    rows = np.lib.stride_tricks.as_strided(raw, (count, row), (stride, 1), writeable=False)
    return np.ascontiguousarray(rows).view(dtype).reshape(count, width)


def _srgb(linear: AnyArray) -> UInt8:
    x = np.clip(linear, 0, 1)
    curved = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * curved), np.uint8)


def _frame(document: dict[str, Any]) -> str:
    ours = str(document.get("asset", {}).get("generator", "")).startswith("pseudolidar ")
    return str(document["nodes"][0]["name"]) if ours else UNKNOWN_FRAME


def _joined(pieces: list[tuple[Float64, AnyArray, UInt8 | None]], frame: str) -> Mesh:
    vertices = np.concatenate([piece[0] for piece in pieces])
    starts = np.cumsum([0] + [len(piece[0]) for piece in pieces[:-1]])
    triangles = [p[1] + start for p, start in zip(pieces, starts, strict=True)]
    colours = [p[2] for p in pieces if p[2] is not None]
    check_places(vertices)
    return Mesh(
        vertices if np.abs(vertices).max() > 1e4 else vertices.astype(np.float32),
        np.concatenate(triangles).astype(np.int32),
        frame,
        np.concatenate(colours) if len(colours) == len(pieces) else None,
    )
