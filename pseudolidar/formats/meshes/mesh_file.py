"""Mesh files of any format, by extension."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from pseudolidar.errors import UsageError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.meshes.glb import encode_glb
from pseudolidar.formats.meshes.glb_reader import read_glb
from pseudolidar.formats.meshes.obj import encode_obj, read_obj
from pseudolidar.formats.meshes.ply import encode_ply_mesh, read_ply_mesh
from pseudolidar.structures.mesh import Mesh

MeshFormat = Literal["ply", "glb", "obj"]

ENCODERS: dict[MeshFormat, Callable[[Mesh], bytes]] = {
    "ply": encode_ply_mesh,
    "glb": encode_glb,
    "obj": encode_obj,
}


def read_mesh(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """Read a mesh of the format that its extension says.

    Raises:
        UsageError: another extension.
        PseudolidarError: as the format's own reader.
    """
    match path.suffix.lower():
        case ".ply":
            return read_ply_mesh(path, limits=limits)
        case ".glb":
            return read_glb(path, limits=limits)
        case ".obj":
            return read_obj(path, limits=limits)
    raise UsageError(
        f"a mesh called {path.name!r}", want=", ".join(f".{name}" for name in ENCODERS), path=path
    )
