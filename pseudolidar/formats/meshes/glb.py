"""Meshes as glTF binary, which browsers, Blender and game engines open.

Source: glTF 2.0 specification, registry.khronos.org/glTF/specs/2.0, chapters 3.6 (accessors), 3.7
(meshes) and 4 (GLB); extension KHR_materials_unlit.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar import __version__
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.structures.arrays import AnyArray, Float32, Float64, UInt8
from pseudolidar.structures.mesh import Mesh

MAGIC, VERSION, JSON_CHUNK, BIN_CHUNK = b"glTF", 2, b"JSON", b"BIN\0"
FLOAT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5123, 5125
VERTEX_BUFFER, INDEX_BUFFER = 34962, 34963
TRIANGLES = 4
# glTF has y up, our maps have z: a quarter turn about x, as quaternion xyzw.
Z_UP_TO_Y_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]


def write_glb(path: Path, mesh: Mesh) -> None:
    """Write a mesh with its colours and normals; the scene's node turns z up into y up.

    Raises:
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_glb(mesh))


def encode_glb(mesh: Mesh, *, light: Float32 | None = None) -> bytes:
    """The bytes of a GLB: one mesh, one primitive, unlit, for photos have their light in them.

    Positions are single precision about the middle of the mesh, which the node moves back: a map
    in geo-referenced coordinates keeps its millimetres.

    Args:
        mesh: the surface.
        light: (V, 3) linear light of its vertices in place of `rgb`, of any brightness.
    """
    vertices = mesh.vertices.astype(np.float64)
    middle = (vertices.min(0) + vertices.max(0)) / 2 if len(vertices) else np.zeros(3)
    body = _Body()
    attributes = {"POSITION": body.add((vertices - middle).astype("<f4"), "VEC3", FLOAT)}
    if mesh.normals is not None:
        attributes["NORMAL"] = body.add(mesh.normals.astype("<f4"), "VEC3", FLOAT)
    if light is not None:
        attributes["COLOR_0"] = body.add(light.astype("<f4"), "VEC3", FLOAT)
    elif mesh.rgb is not None:
        attributes["COLOR_0"] = body.add(_opaque(mesh.rgb), "VEC4", UNSIGNED_SHORT)
    indices = body.add(mesh.triangles.astype("<u4").ravel(), "SCALAR", UNSIGNED_INT)
    primitive = {"attributes": attributes, "indices": indices, "mode": TRIANGLES, "material": 0}
    document = {
        "asset": {"version": "2.0", "generator": f"pseudolidar {__version__}"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": mesh.frame, "rotation": Z_UP_TO_Y_UP, "children": [1]},
            {"mesh": 0, "translation": middle.tolist()},
        ],
        "meshes": [{"primitives": [primitive]}] if len(mesh) else [],
        "materials": [
            {
                "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1},
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "accessors": body.accessors,
        "bufferViews": body.views,
        "buffers": [{"byteLength": len(body.data)}],
    }
    if not len(mesh):  # empty arrays are not legal
        document = {"asset": document["asset"], "scene": 0, "scenes": [{}]}
    text = json.dumps(document, separators=(",", ":")).encode()
    chunks = _chunk(JSON_CHUNK, text, b" ")
    if len(mesh):
        chunks += _chunk(BIN_CHUNK, bytes(body.data), b"\0")
    return struct.pack("<4sII", MAGIC, VERSION, 12 + len(chunks)) + chunks


class _Body:
    """The binary chunk, and what the document says of it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []

    def add(self, array: AnyArray, kind: str, component: int) -> int:
        """Append an array; returns the number of its accessor."""
        target = INDEX_BUFFER if kind == "SCALAR" else VERTEX_BUFFER
        at = len(self.data)
        self.data += array.tobytes()
        self.data += bytes(-len(self.data) % 4)
        self.views.append(
            {"buffer": 0, "byteOffset": at, "byteLength": array.nbytes, "target": target}
        )
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": component,
            "count": len(array),
            "type": kind,
        }
        if component == UNSIGNED_SHORT:
            accessor["normalized"] = True
        if kind == "VEC3" and not self.accessors and len(array):  # positions must have bounds
            accessor["min"], accessor["max"] = array.min(0).tolist(), array.max(0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def linear_light(rgb: UInt8) -> Float64:
    """Light, 0 to 1, of colours in sRGB, by IEC 61966-2-1; of the same shape."""
    share = np.arange(256) / 255.0
    table = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(table[rgb])


def _opaque(rgb: UInt8) -> AnyArray:
    """(V, 4) colours of linear light in 16 bits, as glTF wants them."""
    full = np.full((len(rgb), 4), 65535, "<u2")
    full[:, :3] = np.rint(65535 * linear_light(rgb)).astype("<u2")
    return full


def _chunk(kind: bytes, data: bytes, padding: bytes) -> bytes:
    data += padding * (-len(data) % 4)
    return struct.pack("<I4s", len(data), kind) + data
