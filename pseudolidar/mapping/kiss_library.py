"""The one door to KISS-ICP: its parts, set up with our settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import MissingDependency
from pseudolidar.structures.arrays import Float64

# As KISS-ICP has them (Vizzo et al., RA-L 2023, and its configuration).
POINTS_PER_VOXEL = 20
MOST_ITERATIONS, CONVERGED = 500, 1e-4
LEAST_MOTION_M = 0.1


@dataclass(frozen=True, eq=False)
class Kiss:
    """KISS-ICP's parts: a map, a threshold that follows how far predictions are off, and ICP.

    Args:
        voxel_m: side of the map's voxels.
        farthest_m: points farther from the sensor leave the map.
        threshold_m: how far predictions are off at first.
    """

    voxel_m: float
    farthest_m: float
    threshold_m: float

    def voxel_map(self) -> Any:
        """An empty map of points, forgotten where they are far from the sensor."""
        from kiss_icp.mapping import VoxelHashMap

        return VoxelHashMap(self.voxel_m, self.farthest_m, POINTS_PER_VOXEL)

    def threshold(self) -> Any:
        """The adaptive threshold."""
        from kiss_icp.threshold import get_threshold_estimator

        return get_threshold_estimator(self._config())

    def registration(self) -> Any:
        """Point to point ICP, on one thread: the same result every time."""
        from kiss_icp.registration import Registration

        return Registration(MOST_ITERATIONS, CONVERGED, max_num_threads=1)

    def _config(self) -> Any:
        from kiss_icp.config import KISSConfig

        config = KISSConfig()
        config.data.max_range = self.farthest_m
        config.adaptive_threshold.initial_threshold = self.threshold_m
        config.adaptive_threshold.min_motion_th = LEAST_MOTION_M
        config.adaptive_threshold.fixed_threshold = None
        return config


def thinned(xyz: Float64, voxel_m: float) -> Float64:
    """One point of each voxel, as KISS-ICP thins scans."""
    from kiss_icp.voxelization import voxel_down_sample

    if not len(xyz):
        return xyz
    return np.asarray(voxel_down_sample(xyz, voxel_m))


def load_kiss(*, voxel_m: float, farthest_m: float, threshold_m: float) -> Kiss:
    """Import KISS-ICP, and keep the settings.

    Raises:
        MissingDependency: it is absent or does not load.
    """
    try:
        import kiss_icp.kiss_icp  # noqa: F401  # all of its parts
    except (ImportError, OSError) as error:
        raise MissingDependency(
            f"kiss-icp does not load: {error}",
            want="kiss-icp 1.2 or newer",
            fix="Run `pip install kiss-icp`.",
            where="kiss-icp",
        ) from error
    return Kiss(voxel_m, farthest_m, threshold_m)
