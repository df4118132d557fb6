"""Truncated signed distances in open3d's voxel blocks, filled by a kernel of ours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.errors import MemoryLimit
from pseudolidar.geometry.open3d_library import load_open3d
from pseudolidar.mapping import tsdf_kernels as kernels
from pseudolidar.mapping.mesh_cleaning import cleaned, decimated, ordered
from pseudolidar.mapping.pixel_planes import pixel_planes
from pseudolidar.structures.arrays import AnyArray, Float32, Int64, UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.mesh import Mesh
from pseudolidar.structures.pose import Pose

if TYPE_CHECKING:
    from pseudolidar.mapping.mesh import TsdfMesh

# Bytes of a block: distance, weight and colour of its voxels, twice, for a table that grows holds
# itself twice; `extract` needs less.
BLOCK_BYTES = 2 * kernels.BLOCK**3 * (4 + 4 + 12)
# Blocks that a grid has room for at first.
FIRST_BLOCKS = 4096


class TsdfGrid:
    """Voxels that depth maps are averaged into."""

    def __init__(self, settings: TsdfMesh, rig: StereoRig) -> None:
        self.settings, self.voxel_m = settings, settings.voxel_m
        self.frame = "map"
        K = rig.left.K
        self._camera = rig.left
        self._focal = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
        self._most = max(settings.memory_mb * 10**6 // BLOCK_BYTES, 1)
        self._grid = self._new_grid()

    @property
    def blocks(self) -> int:
        """Blocks in use."""
        return int(self._grid.hashmap().size())

    def integrate(self, depth_m: Float32, sigma_m: Float32, rgb: UInt8, T_map_camera: Pose) -> None:
        """Average a view into the voxels.

        Args:
            depth_m: (H, W) depth Z, NaN where there is none.
            sigma_m: (H, W) one standard deviation of it, metres.
            rgb: (H, W, 3) the left picture.
            T_map_camera: pose of the left camera.

        Raises:
            MemoryLimit: the map does not fit, not even with voxels of `coarsest_m`.
        """
        self.frame = T_map_camera.dst
        T = T_map_camera.matrix
        planes = self._planes(depth_m, sigma_m)
        while not self._room_for(keys := self._keys(planes, T)):
            self._coarsen()
            planes = self._planes(depth_m, sigma_m)
        self._activate(keys)
        coordinates, places = self._active()
        kernels.integrate(
            planes, np.ascontiguousarray(rgb), self._focal, T_map_camera.inverse().matrix,
            coordinates, places, self.voxel_m, *self._attributes(),
        )  # fmt: skip

    def extract(self) -> Mesh:
        """The surface where distances change sign, cleaned and decimated; in the map's frame."""
        nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), self.frame)
        if not self.blocks:
            return nothing
        least_weight = self.settings.least_looks / self.settings.max_sigma_m**2
        surface = self._grid.extract_triangle_mesh(least_weight)
        triangles = surface.triangle.indices.numpy().astype(np.int32)
        if not len(triangles):
            return nothing
        colours = np.rint(255 * np.clip(surface.vertex.colors.numpy(), 0, 1)).astype(np.uint8)
        raw = Mesh(
            surface.vertex.positions.numpy().copy(), triangles, self.frame, colours,
            surface.vertex.normals.numpy().copy(),
        )  # fmt: skip
        smallest_m2 = self.settings.smallest_part * self.voxel_m**2
        clean = cleaned(ordered(raw), smallest_part_m2=smallest_m2)
        return decimated(clean, self.settings.triangles) if self.settings.triangles else clean

    def _planes(self, depth_m: Float32, sigma_m: Float32) -> Float32:
        return pixel_planes(
            depth_m, sigma_m, self._camera,
            voxel_m=self.voxel_m, max_sigma_m=self.settings.max_sigma_m,
        )  # fmt: skip

    def _keys(self, planes: Float32, T: AnyArray) -> AnyArray:
        """(N, 3) int32 coordinates of the blocks that a view needs."""
        keys = np.empty(1 << 16, np.int64)
        block_m = kernels.BLOCK * self.voxel_m
        while (found := kernels.block_keys(planes, self._focal, T, block_m, keys)) > len(keys):
            keys = np.empty(found, np.int64)
        return _coordinates(np.unique(keys[:found]))

    def _room_for(self, coordinates: AnyArray) -> bool:
        if not len(coordinates) or self.blocks + len(coordinates) <= self._most:
            return True
        _, there = self._grid.hashmap().find(_tensor(coordinates))
        return self.blocks + int((~there.numpy()).sum()) <= self._most

    def _activate(self, coordinates: AnyArray) -> None:
        if not len(coordinates):
            return
        table = self._grid.hashmap()
        wanted = self.blocks + len(coordinates)
        if wanted > table.capacity():
            table.reserve(max(wanted, min(2 * table.capacity(), self._most)))
        table.activate(_tensor(coordinates))

    def _active(self) -> tuple[AnyArray, AnyArray]:
        """(B, 3) coordinates and (B,) places of all blocks in use."""
        table = self._grid.hashmap()
        places = table.active_buf_indices().numpy()
        return np.ascontiguousarray(table.key_tensor().numpy()[places]), places

    def _attributes(self) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Distance, weight and colour of all voxels, in open3d's own memory."""
        distance, weight, colour = (
            self._grid.attribute(name).numpy() for name in ("tsdf", "weight", "color")
        )
        return distance, weight, colour

    def _new_grid(self) -> Any:
        core = load_open3d().core
        return load_open3d().t.geometry.VoxelBlockGrid(
            ("tsdf", "weight", "color"), (core.float32,) * 3, ((1,), (1,), (3,)),
            self.voxel_m, kernels.BLOCK, min(self._most, FIRST_BLOCKS),
        )  # fmt: skip

    def _coarsen(self) -> None:
        """Double the voxels: those at even places stay, with all that they hold."""
        if 2 * self.voxel_m > self.settings.coarsest_m:
            raise MemoryLimit(
                f"a mesh of more than {self._most} blocks with voxels of {self.voxel_m:g} m",
                want=f"at most {self.settings.memory_mb} MB",
                fix="Raise the mesh's memory-mb, or take a shorter part of the sequence.",
            )
        coordinates, places = self._active()
        held = [array[places][:, ::2, ::2, ::2] for array in self._attributes()]
        self.voxel_m *= 2
        self._grid = self._new_grid()
        if not len(coordinates):
            return
        coarse, row = np.unique(coordinates >> 1, axis=0, return_inverse=True)
        self._activate(coarse)
        found, _ = self._grid.hashmap().find(_tensor(coarse))
        target, half = found.numpy()[row.ravel()], kernels.BLOCK // 2
        for octant in range(8):
            corner = np.array([octant & 1, octant >> 1 & 1, octant >> 2])
            mine = (coordinates & 1 == corner).all(axis=1)
            x, y, z = (slice(half * c, half * (c + 1)) for c in corner)
            for array, values in zip(self._attributes(), held, strict=True):
                array[target[mine], z, y, x] = values[mine]


def _coordinates(keys: Int64) -> AnyArray:
    mask = (1 << kernels.KEY_BITS) - 1
    shifts = (2 * kernels.KEY_BITS, kernels.KEY_BITS, 0)
    return np.stack([(keys >> s & mask) - kernels.KEY_HALF for s in shifts], axis=1).astype(
        np.int32
    )


def _tensor(array: AnyArray) -> Any:
    return load_open3d().core.Tensor.from_numpy(np.ascontiguousarray(array))
