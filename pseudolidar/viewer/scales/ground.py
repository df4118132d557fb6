"""How high the ground is, and rings of range on it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pseudolidar.clouds.ground_fit import GroundFit, fit_ground
from pseudolidar.geometry.planes import Plane
from pseudolidar.structures.arrays import AnyArray, Float32
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

# The ground is told by the points before the rig, in this part of x and y, that lie on the plane
# that most of the ground is, so near to it; roads are not flat, and a rig is not level.
BEFORE_M, BESIDE_M, NEAR_M = (4.0, 12.0), 2.5, 0.3
# Where no ground is found it is below all but this share of the points.
LOW_SHARE = 0.02
RANGES_M = (5.0, 10.0, 20.0, 30.0, 50.0, 80.0)
CORNERS = 96


def ground_below_m(clouds: Iterable[PointCloud]) -> float | None:
    """Height of the ground before the origin of clouds of one frame; None without points.

    Args:
        clouds: x forward, y left, z up; the first that tells the ground is taken.
    """
    first = None
    for cloud in clouds:
        if not len(cloud):
            continue
        first = cloud if first is None else first
        still = Pose.identity(cloud.frame, cloud.frame)
        plane = fit_ground(cloud, still, np.zeros(3), GroundFit())
        if plane is not None:
            return _before_m(cloud.xyz, plane)
    return None if first is None else low_m(first.xyz)


def _before_m(xyz: AnyArray, plane: Plane) -> float:
    """Height of the middle one of the points (N, 3) of the ground before the rig."""
    x, y, z = xyz.T
    near = (x > BEFORE_M[0]) & (x < BEFORE_M[1]) & (np.abs(y) < BESIDE_M)
    near &= np.abs(plane.heights_m(xyz)) < NEAR_M
    return float(np.median(z[near])) if near.any() else -plane.offset_m / float(plane.normal[2])


def low_m(xyz: AnyArray) -> float:
    """Height that few of the points (N, 3) are below."""
    return float(np.quantile(xyz[:, 2], LOW_SHARE))


def rings(level_m: float) -> Float32:
    """(N, 2, 3) circles about the vertical through the origin, at a height."""
    turns = np.linspace(0, 2 * np.pi, CORNERS + 1)
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    level = np.full((CORNERS + 1, 1), level_m)
    rounds = [np.concatenate([radius * circle, level], axis=1) for radius in RANGES_M]
    return np.concatenate([np.stack([r[:-1], r[1:]], axis=1) for r in rounds]).astype(np.float32)
