"""`--thin voxel`, `--thin uniform`, `--thin density`: fewer points, chosen without chance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.clouds.tool import Tooled
from pseudolidar.errors import UsageError
from pseudolidar.geometry.thinning import thinned
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True)
class Voxel:
    """Keep the surest point of each cube.

    Args:
        edge_m: edge of the cubes, which are aligned to the cloud's frame.
    """

    edge_m: float = 0.1

    def __post_init__(self) -> None:
        if not 0 < self.edge_m < math.inf:
            raise UsageError(f"cubes of {self.edge_m:g} m", want="above 0", where="--thin")

    def load(self) -> Self:
        """Itself, its kernel compiled or read from the cache."""
        from pseudolidar.geometry import voxels  # noqa: F401  compiles on import

        return self

    def __call__(self, cloud: PointCloud, _tree: tuple[Pose, ...]) -> Tooled:
        """The surest point of each cube; a real point, with all its columns."""
        from pseudolidar.geometry.voxels import best_of_voxel

        keep = best_of_voxel(cloud.xyz, cloud.sigma_m, voxel_m=self.edge_m)
        return _thinned(cloud, cloud[keep])


@dataclass(frozen=True)
class Uniform:
    """Keep so many points, evenly over the cloud in its order: of an image, every n-th pixel.

    Args:
        points: how many.
    """

    points: int = 50_000

    def __post_init__(self) -> None:
        _check(self.points)

    def load(self) -> Self:
        """Itself: it is light."""
        return self

    def __call__(self, cloud: PointCloud, _tree: tuple[Pose, ...]) -> Tooled:
        """Points at even steps; exactly `points` of them, or all."""
        there = np.flatnonzero(cloud.valid)
        most = min(self.points, len(there))
        steps = np.arange(most, dtype=np.int64) * len(there) // max(most, 1)
        return _thinned(cloud, cloud[there[steps]])


@dataclass(frozen=True)
class Density:
    """Keep so many points, as dense on far surfaces as on near ones: far and sure ones stay.

    Args:
        points: how many.
    """

    points: int = 50_000

    def __post_init__(self) -> None:
        _check(self.points)

    def load(self) -> Self:
        """Itself: it is light."""
        return self

    def __call__(self, cloud: PointCloud, _tree: tuple[Pose, ...]) -> Tooled:
        """At most `points` of them; how is said at `geometry.thinning.thinned`."""
        there = cloud if cloud.shape is None else cloud[cloud.valid]
        return _thinned(cloud, thinned(there, self.points))


def _check(points: int) -> None:
    if points < 1:
        raise UsageError(f"{points} points", want="at least 1", where="--thin")


def _thinned(before: PointCloud, after: PointCloud) -> Tooled:
    return Tooled(after, {"points_thinned": int(np.count_nonzero(before.valid)) - len(after)})
