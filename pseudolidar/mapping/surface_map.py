"""What was seen before, as KISS-ICP's map of points, and the surfaces that they lie on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.mapping.kiss_library import Kiss
from pseudolidar.structures.arrays import Bool, Float64, Int64

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# A surface is told by so many points of the map; they lie flat where the least variance is at most
# this share of the middle one, and no surface is told where they lie on a line.
NEIGHBOURS, FLATTEST, LEAST_WIDTH = 10, 0.1, 1e-3


class SurfaceMap:
    """KISS-ICP's voxel map in the odometry's frame.

    Args:
        kiss: with its settings.
    """

    def __init__(self, kiss: Kiss) -> None:
        self._map = kiss.voxel_map()

    @property
    def empty(self) -> bool:
        """Whether nothing was added, or all of it is far away."""
        return bool(self._map.empty())

    def add(self, xyz: Float64, T_odom_sensor: Float64) -> None:
        """Add points (N, 3) of the sensor; those that are far from it now are forgotten."""
        self._map.update(np.ascontiguousarray(xyz), T_odom_sensor)

    def surfaces(self) -> Surfaces:
        """The map as it is now."""
        return Surfaces(np.asarray(self._map.point_cloud()).reshape(-1, 3))


class Surfaces:
    """Points of a map and, where they are asked for, the normals of surfaces through them.

    Args:
        xyz: (M, 3) float64 m.
    """

    def __init__(self, xyz: Float64) -> None:
        from scipy.spatial import cKDTree

        self.xyz = xyz
        self._tree: cKDTree = cKDTree(xyz, balanced_tree=False, compact_nodes=False)
        self._normals = np.full((len(xyz), 3), np.nan)
        self._asked = np.zeros(len(xyz), bool)

    def __len__(self) -> int:
        return len(self.xyz)

    def nearest(self, xyz: Float64, within_m: float) -> tuple[Int64, Bool]:
        """For points (N, 3) the nearest of the map (N,), and whether there is one that near."""
        if not len(self):
            return np.zeros(len(xyz), np.int64), np.zeros(len(xyz), bool)
        distance, index = self._tree.query(xyz, distance_upper_bound=within_m)
        found = np.isfinite(distance)
        return np.where(found, index, 0), found

    def normals(self, index: Int64) -> Float64:
        """(N, 3) of length 1, of either sign; NaN where the map is not flat."""
        new = np.unique(index[~self._asked[index]])
        if len(new) and len(self) >= NEIGHBOURS:
            _, near = self._tree.query(self.xyz[new], k=NEIGHBOURS)
            self._normals[new] = _flat_normals(self.xyz[near])
        self._asked[new] = True
        return self._normals[index]


def _flat_normals(groups: Float64) -> Float64:
    """(G, 3) normals of groups of points (G, K, 3), NaN where they are not flat."""
    centred = groups - groups.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("gki,gkj->gij", centred, centred))
    flat = values[:, 0] <= FLATTEST * values[:, 1]
    flat &= values[:, 1] > LEAST_WIDTH * values[:, 2]
    return np.where(flat[:, None], vectors[:, :, 0], np.nan)
