"""A handful of views with the points that they share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Float64, Int64, check_array
from pseudolidar.structures.cloud import PointCloud


@dataclass(frozen=True, eq=False)
class SparseModel:
    """Where pictures were taken, and points that several of them show.

    Args:
        names: of the pictures, in order.
        T_world_camera: (N, 4, 4) float64, optical axes; in metres only where `scaled`.
        points: in `world`, with colour, `extra` columns `views` and `error_px`.
        K: (N, 3, 3) float64 pinhole of each picture.
        error_px: mean reprojection error.
        left_out: pictures that fit to none.
        scaled: whether its lengths are metres.
    """

    names: tuple[str, ...]
    T_world_camera: Float64
    points: PointCloud
    K: Float64
    error_px: float
    left_out: tuple[str, ...] = ()
    scaled: bool = False

    def __post_init__(self) -> None:
        n = len(self.names)
        check_array("SparseModel", "T_world_camera", self.T_world_camera, (n, 4, 4), np.float64)
        check_array("SparseModel", "K", self.K, (n, 3, 3), np.float64)

    def distance(self, a: str, b: str) -> float:
        """Between the cameras of two pictures.

        Raises:
            StructureError: one of them is not in the model.
        """
        for name in (a, b):
            if name not in self.names:
                raise StructureError(f"no picture {name!r}", want=", ".join(self.names[:9]))
        places = self.T_world_camera[[self.names.index(a), self.names.index(b)], :3, 3]
        return float(np.linalg.norm(places[0] - places[1]))

    def times(self, scale: float) -> Self:
        """The same, so many times as large, in metres."""
        poses = self.T_world_camera.copy()
        poses[:, :3, 3] *= scale
        xyz = (self.points.xyz * scale).astype(self.points.xyz.dtype)
        return replace(
            self, T_world_camera=poses, points=replace(self.points, xyz=xyz), scaled=True
        )

    @property
    def views(self) -> Int64:
        """(M,) how many pictures show each point."""
        return np.asarray(self.points.extra["views"])
