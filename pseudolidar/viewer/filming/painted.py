"""Clouds and paths as points with colours, all that a film is drawn of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pseudolidar.errors import CloudEmpty
from pseudolidar.geometry.mesh_surface import spread_over
from pseudolidar.geometry.path_length import travelled_m
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import Colouring, ways
from pseudolidar.viewer.meshes import surface_colours
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.stills import Still, StillCloud, StillMesh, StillOctree, StillPath
from pseudolidar.viewer.thinned import thinned

# Of one cloud, in a film: more do not show at its size.
MOST_POINTS = 3_000_000
# A mesh is drawn as so many points.
SURFACE_POINTS = 1_000_000
# A path is drawn as points so near to one another, m, and at most so many.
STEP_M, MOST_STEPS = 0.04, 200_000


class Painter:
    """Colours clouds as a page does; the same cloud has the same scale of colours in every frame.

    Args:
        looks: how clouds look, by name; of others what their first one suits.
        origin_m: (3,) what all places are relative to, so that float32 loses nothing.
    """

    def __init__(self, looks: Mapping[str, Look], origin_m: Float64) -> None:
        self._looks, self._origin_m = looks, origin_m
        self._colourings: dict[str, Colouring] = {}

    def visible(self, name: str) -> bool:
        """Whether a cloud is drawn."""
        return self._looks.get(name, Look()).visible

    def pose(self, T_map_cloud: Float64 | None) -> Float64:
        """(4, 4) the same pose relative to the origin; None where it is in the map already."""
        T = np.eye(4) if T_map_cloud is None else T_map_cloud.copy()
        T[:3, 3] -= self._origin_m
        return T

    def cloud(self, name: str, cloud: PointCloud, T_map_cloud: Float64 | None = None) -> PointCloud:
        """A cloud with its colours, where it is in the map.

        Args:
            name: says how it looks.
            cloud: z up.
            T_map_cloud: (4, 4) where it is; None where it is in the map already.
        """
        few = thinned(cloud, MOST_POINTS)
        T = self.pose(T_map_cloud)
        xyz = few.xyz @ T[:3, :3].T + T[:3, 3]
        return PointCloud(
            xyz.astype(np.float32), "film", rgb=self._colouring(name, few).colours(few)
        )

    def path(self, path: StillPath) -> PointCloud:
        """A path as a row of points."""
        count = int(np.clip(path.length_m / STEP_M, 1, MOST_STEPS))
        places = evenly(path.places_m, count) - self._origin_m
        rgb = np.full((len(places), 3), path.colour, np.uint8)
        return PointCloud(places.astype(np.float32), "film", rgb=rgb)

    def still(self, still: Still) -> PointCloud:
        """Anything that does not change."""
        if isinstance(still, StillOctree):
            still = still.coarse(MOST_POINTS)
        if isinstance(still, StillCloud):
            return self.cloud(still.name, still.cloud)
        return self.path(still) if isinstance(still, StillPath) else self.mesh(still)

    def mesh(self, still: StillMesh) -> PointCloud:
        """A surface as points that cover it."""
        mesh = still.mesh
        shown = surface_colours(still, self._colouring(still.name, still.points))
        corners, weights = spread_over(mesh, SURFACE_POINTS)
        xyz = np.einsum("nc,nci->ni", weights, mesh.vertices[corners] - self._origin_m)
        rgb = np.einsum("nc,nci->ni", weights, shown[corners])
        return PointCloud(xyz.astype(np.float32), "film", rgb=np.rint(rgb).astype(np.uint8))

    def _colouring(self, name: str, cloud: PointCloud) -> Colouring:
        if name not in self._colourings:
            look = self._looks.get(name)
            possible = ways(cloud)
            wanted = Colouring(possible[0]) if look is None else look.colouring
            chosen = wanted if wanted.by in possible else Colouring(possible[0])
            self._colourings[name] = chosen.settled(cloud)
        return self._colourings[name]


def nothing_seen(why: str = "") -> CloudEmpty:
    """What there is no film of.

    Args:
        why: what was said of it; "" where nothing was.
    """
    return CloudEmpty(
        "nothing that could be seen" + (f": {why}" if why else ""),
        want="a cloud, a map, or a sequence",
        fix="Give a path with points in it.",
    )


def joined(clouds: Sequence[PointCloud]) -> PointCloud:
    """Painted clouds as one."""
    xyz = [cloud.xyz for cloud in clouds] or [np.zeros((0, 3), np.float32)]
    rgb = [cloud.rgb for cloud in clouds if cloud.rgb is not None] or [np.zeros((0, 3), np.uint8)]
    return PointCloud(np.concatenate(xyz), "film", rgb=np.concatenate(rgb))


def evenly(places_m: Float64, count: int) -> Float64:
    """(M, 3) so many places along a line, as far from one another as the next ones."""
    way = travelled_m(places_m)
    at = np.linspace(0, way[-1], count)
    return np.stack([np.interp(at, way, axis) for axis in places_m.T], axis=1)
