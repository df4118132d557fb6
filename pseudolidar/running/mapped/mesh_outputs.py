"""The mesh of a map: formats, files, figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, get_args

from pseudolidar.errors import UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.meshes.mesh_file import ENCODERS, MeshFormat
from pseudolidar.geometry.mesh_holes import openings
from pseudolidar.structures.mesh import Mesh

MESH_NAME = "mesh"
KINDS: dict[str, MeshFormat] = {kind: kind for kind in get_args(MeshFormat)}


@dataclass(frozen=True)
class MeshOutputs:
    """Formats that a mesh is written in.

    Args:
        kinds: names in the order given.
    """

    kinds: tuple[MeshFormat, ...] = ("ply", "glb")

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `ply,glb,obj`.

        Raises:
            UsageError: an unknown name, or one twice, or none.
        """
        names = [part.strip() for part in text.split(",") if part.strip()]
        if not names or not set(names) <= KINDS.keys() or len(set(names)) < len(names):
            raise UsageError(f"{text!r}", want=f"a comma list, each once, of {', '.join(KINDS)}")
        return cls(tuple(KINDS[name] for name in names))

    def __str__(self) -> str:
        return ",".join(self.kinds)

    @property
    def files(self) -> tuple[str, ...]:
        """Names in the output folder."""
        return tuple(f"{MESH_NAME}.{kind}" for kind in self.kinds)

    def write(self, folder: Path, mesh: Mesh) -> tuple[Path, ...]:
        """Write the files; none of a mesh without triangles.

        Raises:
            OutputError: the disk is full or gone.
        """
        if not len(mesh):
            return ()
        for name, kind in zip(self.files, self.kinds, strict=True):
            write_atomic(folder / name, ENCODERS[kind](mesh))
        return tuple(folder / name for name in self.files)


def mesh_figures(mesh: Mesh, voxel_m: float) -> Mapping[str, Any]:
    """Size of a mesh, and the holes in it: nothing promises that it is closed."""
    ends = openings(mesh)
    return {
        "triangles": len(mesh),
        "vertices": len(mesh.vertices),
        "area_m2": float(mesh.areas_m2.sum()),
        "voxel_m": voxel_m,
        "holes": ends.holes,
        "holes_m2": ends.holes_m2,
        "largest_hole_m2": ends.largest_hole_m2,
    }
