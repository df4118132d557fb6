"""`--ground label`, `--ground remove`: the ground told from what stands on it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pseudolidar.clouds.ground_fit import GroundFit, fit_ground, ground_points
from pseudolidar.clouds.tool import Tooled, forward_of, kept, origin_of
from pseudolidar.geometry.planes import Plane
from pseudolidar.structures.arrays import Bool
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

GROUND_COLUMN = "ground"
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Label:
    """Add the column `ground`: 1 for points on the ground plane, 0 for all others.

    Args:
        fit: how the ground is looked for.
    """

    fit: GroundFit = field(default_factory=GroundFit)

    def load(self) -> Ground:
        """The tool."""
        return Ground("label", self.fit)


@dataclass(frozen=True)
class Remove:
    """Leave out the points on the ground plane.

    Args:
        fit: how the ground is looked for.
    """

    fit: GroundFit = field(default_factory=GroundFit)

    def load(self) -> Ground:
        """The tool."""
        return Ground("remove", self.fit)


@dataclass(frozen=True)
class Ground:
    """Finds the ground plane, and labels or removes its points.

    Args:
        use: what is done with the points.
        fit: how it is looked for.
    """

    use: Literal["label", "remove"]
    fit: GroundFit

    def __call__(self, cloud: PointCloud, tree: tuple[Pose, ...]) -> Tooled:
        """Label or remove; where no ground is found all points stay, and none is ground.

        Figures: points of the ground, height of the sensor above it (the origin of `velodyne`
        where that is known) and its tilt against the sensor's up.
        """
        plane, is_ground = self.found(cloud, tree)
        figures: dict[str, float] = {"points_on_ground": int(np.count_nonzero(is_ground))}
        if plane is not None:
            figures["ground_height_m"] = round(plane.offset_m, 4)
            figures["ground_tilt_deg"] = round(plane.tilt_deg(UP), 4)
        if self.use == "remove":
            return Tooled(kept(cloud, ~is_ground & cloud.valid), figures)
        extra = {**cloud.extra, GROUND_COLUMN: is_ground.astype(np.uint8)}
        return Tooled(replace(cloud, extra=extra), figures)

    def found(self, cloud: PointCloud, tree: tuple[Pose, ...]) -> tuple[Plane | None, Bool]:
        """The plane in a frame with z up (`velodyne` where it is known), and (N,) its points."""
        T_forward_cloud = forward_of(cloud, tree)
        origin_m = T_forward_cloud.apply(origin_of(cloud, tree)[None])[0]
        plane = fit_ground(cloud, T_forward_cloud, origin_m, self.fit)
        if plane is None:
            return None, np.zeros(len(cloud), bool)
        return plane, ground_points(plane, cloud, T_forward_cloud, origin_m, self.fit)
