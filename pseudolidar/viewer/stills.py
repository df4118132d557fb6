"""What does not change from frame to frame: clouds, maps, paths, meshes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pseudolidar.geometry.mesh_surface import vertex_normals
from pseudolidar.geometry.path_length import length_m
from pseudolidar.structures.arrays import AnyArray, Float32, Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.mesh import Mesh
from pseudolidar.viewer.octree.tree import Octree

PATH_COLOUR, TRUTH_COLOUR = (80, 200, 120), (235, 95, 200)
# Of a large cloud every browser draws the coarsest points, wherever it looks.
SHARED_POINTS = 300_000
# Where colours of a mesh are no photo light falls from here, and leaves this share to what faces
# away.
LIGHT, DARKEST = np.array([0.36, 0.24, 0.9]), 0.4


@dataclass(frozen=True, eq=False)
class StillCloud:
    """A cloud that lies still.

    Args:
        name: of the file.
        cloud: x forward, y left, z up.
    """

    name: str
    cloud: PointCloud

    @property
    def amount(self) -> str:
        """How much there is of it, in words."""
        return f"{len(self.cloud):,} points"


@dataclass(frozen=True, eq=False)
class StillPath:
    """A path.

    Args:
        name: of the file.
        places_m: (N, 3) float64.
        colour: red, green, blue.
    """

    name: str
    places_m: Float64
    colour: tuple[int, int, int] = PATH_COLOUR

    @property
    def amount(self) -> str:
        """How much there is of it, in words."""
        return f"a path of {self.length_m:.1f} m"

    @property
    def length_m(self) -> float:
        """From pose to pose."""
        return length_m(self.places_m)


@dataclass(frozen=True, eq=False)
class StillOctree:
    """A cloud that is too large to be sent whole.

    Args:
        name: of the file.
        tree: x forward, y left, z up.
    """

    name: str
    tree: Octree

    @property
    def amount(self) -> str:
        """How much there is of it, in words."""
        return f"{len(self.tree):,} points, the near ones drawn finely"

    def coarse(self, most: int = SHARED_POINTS) -> StillCloud:
        """Its coarsest levels, with at most so many points if the first level has no more."""
        return StillCloud(self.name, self.tree.cloud(self.tree.coarsest(most).tolist()))


@dataclass(frozen=True, eq=False)
class StillMesh:
    """A surface.

    Args:
        name: of the file.
        mesh: x forward, y left, z up; at least one triangle.
    """

    name: str
    mesh: Mesh

    @property
    def amount(self) -> str:
        """How much there is of it, in words."""
        return f"{len(self.mesh):,} triangles"

    @property
    def points(self) -> PointCloud:
        """Its vertices."""
        return PointCloud(self.mesh.vertices, self.mesh.frame, rgb=self.mesh.rgb)

    @cached_property
    def shade(self) -> Float32:
        """(V,) how bright light makes each vertex, 0 to 1."""
        lit = np.abs(vertex_normals(self.mesh) @ (LIGHT / np.linalg.norm(LIGHT)))
        return np.asarray(DARKEST + (1 - DARKEST) * lit, np.float32)


Still = StillCloud | StillPath | StillOctree | StillMesh


def middle_m(still: Still) -> Float64:
    """(3,) a place in it, for all numbers on the wire to be relative to."""
    if isinstance(still, StillOctree):
        still = still.coarse()
    places = places_of(still)
    if not len(places):
        return np.zeros(3)
    return np.asarray(np.median(places, axis=0), np.float64)


def is_empty(still: Still) -> bool:
    """Whether there is nothing of it."""
    return not isinstance(still, StillOctree) and not len(places_of(still))


def places_of(still: StillCloud | StillPath | StillMesh) -> AnyArray:
    """(N, 3) points, poses or vertices."""
    if isinstance(still, StillMesh):
        return still.mesh.vertices
    return still.cloud.xyz if isinstance(still, StillCloud) else still.places_m
