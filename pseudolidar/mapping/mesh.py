"""A mesh out of depth maps, as settings: light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pseudolidar.structures.camera import StereoRig

if TYPE_CHECKING:
    from pseudolidar.mapping.tsdf_grid import TsdfGrid


@dataclass(frozen=True)
class TsdfMesh:
    """Fuse depth maps into a coloured mesh, each pixel weighted by its sigma.

    open3d's own integration weights all pixels alike, and measures distances along the ray: here a
    kernel of ours fills the voxels of open3d's blocks, and open3d finds the surface in them.

    Args:
        voxel_m: side of a voxel. It doubles whenever the blocks would not fit into `memory_mb`.
        max_sigma_m: pixels whose depth is less sure are not used.
        least_looks: a surface must be as sure as by so many looks with a sigma of `max_sigma_m`.
        smallest_part: parts of less area that hang in the air are dropped, in squares of a voxel.
        triangles: most triangles of the mesh; 0 for as many as there are.
        memory_mb: memory for voxels, in megabytes.
        coarsest_m: a map that does not fit with voxels of this size is refused.
    """

    voxel_m: float = 0.1
    max_sigma_m: float = 0.5
    least_looks: float = 2.0
    smallest_part: float = 50.0
    triangles: int = 0
    memory_mb: int = 1000
    coarsest_m: float = 1.0

    def start(self, rig: StereoRig) -> TsdfGrid:
        """An empty grid for depth maps of the left camera of a rig."""
        from pseudolidar.mapping.tsdf_grid import TsdfGrid

        return TsdfGrid(self, rig)
