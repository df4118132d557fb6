"""`--normals`: the direction that each point's surface faces, as columns nx, ny, nz."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pseudolidar.clouds.tool import Tooled, camera_of, origin_of
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

NORMAL_COLUMNS = ("nx", "ny", "nz")


@dataclass(frozen=True)
class Normals:
    """Add normals, of length 1 and towards the sensor; NaN where no surface is seen.

    Args:
        neighbours: of points that do not know their pixels, how many lie on a plane.
    """

    neighbours: int = 16

    def load(self) -> Self:
        """Itself, its kernels compiled or read from the cache."""
        from pseudolidar.geometry import normal_kernels  # noqa: F401  made on import

        return self

    def __call__(self, cloud: PointCloud, tree: tuple[Pose, ...]) -> Tooled:
        """From neighbouring pixels where the camera is known, else from neighbours in space.

        A cloud that has the columns already gets new ones.
        """
        from pseudolidar.geometry.normals import normals_of_neighbours, normals_of_pixels

        camera = camera_of(cloud, tree)
        if camera is not None and cloud.uv is not None:
            normals = normals_of_pixels(cloud.xyz, cloud.uv, camera.inverse())
        else:
            normals = normals_of_neighbours(
                cloud.xyz, origin_of(cloud, tree), neighbours=self.neighbours
            )
        columns = dict(zip(NORMAL_COLUMNS, np.ascontiguousarray(normals.T), strict=True))
        known = int(np.count_nonzero(np.isfinite(normals[:, 0])))
        return Tooled(replace(cloud, extra={**cloud.extra, **columns}), {"points_normal": known})
