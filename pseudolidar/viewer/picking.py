"""Which point somebody means who clicks into the scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float64
from pseudolidar.structures.cloud import PointCloud

# Points this far beside the line of sight are meant, rad: 6 px of a page 1000 px high.
BESIDE_RAD = 0.006
# Of those that are, the nearest ones: within this share of the nearest's distance.
SAME_SURFACE = 0.03


@dataclass(frozen=True, eq=False)
class Picked:
    """A point of a cloud.

    Args:
        cloud: its name.
        xyz_m: (3,) in the frame of the cloud.
        range_m: from the origin of that frame.
        sigma_m: one standard deviation; None where nobody knows.
        uv: pixel that it was seen in; None where nobody knows.
    """

    cloud: str
    xyz_m: Float64
    range_m: float
    sigma_m: float | None = None
    uv: tuple[float, float] | None = None

    @property
    def text(self) -> str:
        """In words, one line."""
        x, y, z = self.xyz_m
        sigma = "" if self.sigma_m is None else f" ± {self.sigma_m:.2f}"
        pixel = "" if self.uv is None else f", pixel {self.uv[0]:.0f}, {self.uv[1]:.0f}"
        return f"{x:.2f}, {y:.2f}, {z:.2f} m; range {self.range_m:.2f}{sigma} m{pixel}"


def picked(
    clouds: Mapping[str, tuple[PointCloud, Float64]], origin: Float64, direction: Float64
) -> Picked | None:
    """The point on a line of sight, of all clouds the nearest; None where there is none.

    Args:
        clouds: by name, each with the (4, 4) pose of its frame in the scene.
        origin: (3,) of the line, in the scene.
        direction: (3,) of the line.
    """
    best: tuple[float, Picked] | None = None
    for name, (cloud, T_scene_cloud) in clouds.items():
        R, t = T_scene_cloud[:3, :3], T_scene_cloud[:3, 3]
        from_m, towards = R.T @ (origin - t), R.T @ (direction / np.linalg.norm(direction))
        index = nearest_on_line(cloud.xyz, from_m, towards)
        if index is None:
            continue
        along_m = float((cloud.xyz[index] - from_m) @ towards)
        if best is None or along_m < best[0]:
            best = along_m, _point(name, cloud, index)
    return None if best is None else best[1]


def nearest_on_line(xyz: AnyArray, origin: Float64, direction: Float64) -> int | None:
    """Index of the point (N, 3) that a line from `origin` meets first; None where it meets none."""
    away = xyz - origin
    along = away @ direction
    beside = np.linalg.norm(away - along[:, None] * direction, axis=1)
    met = np.flatnonzero((along > 0) & (beside < BESIDE_RAD * along))
    if not len(met):
        return None
    front = met[along[met] <= (1 + SAME_SURFACE) * along[met].min()]
    return int(front[np.argmin(beside[front] / along[front])])


def _point(name: str, cloud: PointCloud, index: int) -> Picked:
    xyz = np.asarray(cloud.xyz[index], np.float64)
    uv = None if cloud.uv is None else (float(cloud.uv[index, 0]), float(cloud.uv[index, 1]))
    sigma_m = None if cloud.sigma_m is None else float(cloud.sigma_m[index])
    return Picked(name, xyz, float(np.linalg.norm(xyz)), sigma_m, uv)
