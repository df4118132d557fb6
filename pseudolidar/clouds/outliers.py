"""`--outliers lonely`: clouds of any origin without points that have few others around them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.clouds.tool import Tooled, count, kept, origin_of
from pseudolidar.errors import StereoConfig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True)
class Lonely:
    """Remove points with few others around them; the radius grows with their distance.

    Args:
        neighbours: other points that a point needs within its radius.
        radius_rel: radius as a share of the distance from the sensor; beams of a LiDAR are 0.007
            of it apart, pixels of a camera 0.0014.
        min_radius_m: smallest radius.
        sigmas: the radius is at least so many times the error of the point, where that is known.
    """

    neighbours: int = 3
    radius_rel: float = 0.015
    min_radius_m: float = 0.05
    sigmas: float = 1.0

    def __post_init__(self) -> None:
        for name in ("neighbours", "radius_rel", "min_radius_m"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise StereoConfig(f"{name} = {value:g}", want="a positive number", where=name)
        if not 0 <= self.sigmas < math.inf:
            raise StereoConfig(f"sigmas = {self.sigmas:g}", want="0 or more", where="sigmas")

    def load(self) -> Self:
        """Itself, its kernel compiled or read from the cache."""
        from pseudolidar.geometry import crowding_kernels  # noqa: F401

        return self

    def __call__(self, cloud: PointCloud, tree: tuple[Pose, ...]) -> Tooled:
        """The points that are not alone."""
        from pseudolidar.geometry.crowding_kernels import crowded

        away = cloud.xyz - origin_of(cloud, tree)
        distance_m = np.sqrt((away * away).sum(axis=1))
        radius_m = np.maximum(self.min_radius_m, self.radius_rel * distance_m)
        if cloud.sigma_m is not None:
            radius_m = np.fmax(radius_m, self.sigmas * cloud.sigma_m.astype(np.float64))
        found = kept(cloud, crowded(cloud.xyz, radius_m, neighbours=self.neighbours))
        return Tooled(found, {"points_removed_as_outliers": count(cloud) - count(found)})
