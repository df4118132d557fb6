"""`--beams`: only the points that a spinning LiDAR would measure, as its detectors expect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from pseudolidar.clouds.tool import Tooled, count, forward_of, kept
from pseudolidar.geometry.beams import every_nth_beam, hdl64, seen_by_beams
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

BeamCount = Literal[64, 32, 16, 4]


@dataclass(frozen=True)
class Beams:
    """Sparsify to the beams of an HDL-64E, or to every second, fourth or sixteenth of them.

    Args:
        count: beams that are left.
    """

    count: BeamCount = 64

    def load(self) -> Self:
        """Itself, its kernel compiled or read from the cache."""
        from pseudolidar.geometry import beam_kernels  # noqa: F401  made on import

        return self

    def __call__(self, cloud: PointCloud, tree: tuple[Pose, ...]) -> Tooled:
        """One point for each firing that hits something, seen from the origin of `velodyne`.

        Without a calibrated Velodyne the LiDAR stands where the cloud's forward frame begins.
        """
        seen = np.zeros(len(cloud), np.bool_)
        xyz = forward_of(cloud, tree).apply(cloud.xyz)
        seen[seen_by_beams(xyz, every_nth_beam(hdl64(), self.count))] = True
        thinned = kept(cloud, seen)
        return Tooled(thinned, {"points_off_beams": count(cloud) - count(thinned)})
