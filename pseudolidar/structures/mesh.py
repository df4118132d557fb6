"""The triangle mesh: vertices with their columns, and triangles between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64, UInt8, check_array


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles; nothing promises that it is closed.

    Args:
        vertices: (V, 3) float32 m (float64 for geo-referenced ones), finite.
        triangles: (T, 3) int32 vertex numbers; counter-clockwise seen from outside.
        frame: coordinate frame.
        rgb: (V, 3) uint8, sRGB.
        normals: (V, 3) float32 of length 1, to the outside.
    """

    vertices: AnyArray
    triangles: AnyArray
    frame: str
    rgb: UInt8 | None = None
    normals: Float32 | None = None

    def __post_init__(self) -> None:
        check_array("Mesh", "vertices", self.vertices, (None, 3), np.float32, np.float64)
        check_array("Mesh", "triangles", self.triangles, (None, 3), np.int32)
        n = len(self.vertices)
        if self.rgb is not None:
            check_array("Mesh", "rgb", self.rgb, (n, 3), np.uint8)
        if self.normals is not None:
            check_array("Mesh", "normals", self.normals, (n, 3), np.float32)
        if not np.isfinite(self.vertices).all():
            raise StructureError(
                "vertices that are not finite", want="metres", where="Mesh.vertices"
            )
        if len(self.triangles) and not (
            self.triangles.min() >= 0 and int(self.triangles.max()) < n
        ):
            raise StructureError(
                f"vertex numbers {self.triangles.min()} to {self.triangles.max()}",
                want=f"0 to {n - 1}",
                where="Mesh.triangles",
            )

    def __len__(self) -> int:
        """How many triangles."""
        return len(self.triangles)

    @property
    def corners(self) -> AnyArray:
        """(T, 3, 3) corners of each triangle, metres."""
        return self.vertices[self.triangles]

    @property
    def areas_m2(self) -> Float64:
        """(T,) area of each triangle."""
        a, b, c = self.corners.astype(np.float64).transpose(1, 0, 2)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    def only(self, kept: Bool) -> Mesh:
        """The triangles of a mask (T,), and the vertices that they use."""
        used, triangles = np.unique(self.triangles[kept], return_inverse=True)
        return Mesh(
            self.vertices[used],
            triangles.reshape(-1, 3).astype(np.int32),
            self.frame,
            None if self.rgb is None else self.rgb[used],
            None if self.normals is None else self.normals[used],
        )
