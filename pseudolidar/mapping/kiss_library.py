"""The one door to KISS-ICP: its parts, set up with our settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import MissingDependency
from pseudolidar.geometry.twists import rigid
from pseudolidar.structures.arrays import Float64

# As KISS-ICP has them (Vizzo et al., RA-L 2023, and its configuration).
POINTS_PER_VOXEL = 20
MOST_ITERATIONS, CONVERGED = 500, 1e-4
LEAST_MOTION_M = 0.1
# Points are matched within so many thresholds.
REACH = 3.0


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

    def voxel_map(self) -> VoxelMap:
        """An empty map."""
        from kiss_icp.mapping import VoxelHashMap

        return VoxelMap(self, VoxelHashMap(self.voxel_m, self.farthest_m, POINTS_PER_VOXEL))

    def threshold(self) -> Threshold:
        """The adaptive threshold."""
        from kiss_icp.threshold import get_threshold_estimator

        return Threshold(self, get_threshold_estimator(self._config()))

    def _config(self) -> Any:
        from kiss_icp.config import KISSConfig

        config = KISSConfig()
        config.data.max_range = self.farthest_m
        config.adaptive_threshold.initial_threshold = self.threshold_m
        config.adaptive_threshold.min_motion_th = LEAST_MOTION_M
        config.adaptive_threshold.fixed_threshold = None
        return config


# The parts have the names of KISS-ICP's own. Poses that are rigid to no better than 1e-10 make its
# library end the whole process (Sophus aborts), and by rounding products of poses become so: each
# is made rigid on its way in.


@dataclass(frozen=True, eq=False)
class VoxelMap:
    """A map of points, forgotten where they are far from the sensor.

    Args:
        kiss: its settings.
        library: KISS-ICP's.
    """

    kiss: Kiss
    library: Any

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as its points."""
        return map_with, (self.kiss, self.point_cloud())

    def empty(self) -> bool:
        """Whether nothing was added, or all of it is far away."""
        return bool(self.library.empty())

    def update(self, xyz: Float64, T_map_sensor: Float64) -> None:
        """Add points (N, 3) of the sensor."""
        self.library.update(np.ascontiguousarray(xyz), rigid(T_map_sensor))

    def point_cloud(self) -> Float64:
        """(M, 3) all of it."""
        return np.asarray(self.library.point_cloud()).reshape(-1, 3)


class Threshold:
    """How far predictions are off, learnt from those that were made.

    The library does not tell what it learnt, so that what it learnt from is kept: not the many
    predictions that were too good to count.

    Args:
        kiss: its settings.
        library: KISS-ICP's, which has learnt nothing yet.
    """

    def __init__(self, kiss: Kiss, library: Any) -> None:
        self._kiss, self._library = kiss, library
        self._learnt = list[Float64]()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as what it learnt from."""
        return threshold_after, (self._kiss, np.reshape(self._learnt, (-1, 4, 4)))

    def get_threshold(self) -> float:
        """One standard deviation, m."""
        return float(self._library.get_threshold())

    def update_model_deviation(self, T_predicted_found: Float64) -> None:
        """A prediction was off by this."""
        self.learn(rigid(T_predicted_found))

    def learn(self, T_predicted_found: Float64) -> None:
        """The same of a pose (4, 4) that is rigid to the last bit."""
        before = self.get_threshold()
        self._library.update_model_deviation(T_predicted_found)
        if self.get_threshold() != before:
            self._learnt.append(T_predicted_found)


@dataclass(frozen=True, eq=False)
class PointToPoint:
    """ICP of points on a map.

    Args:
        library: KISS-ICP's.
    """

    library: Any

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as what it is: it keeps nothing."""
        return point_to_point, ()

    def align(self, xyz: Float64, voxels: VoxelMap, T_guess: Float64, sigma_m: float) -> Float64:
        """(4, 4) pose of points (N, 3) in the map, near a guess that is off by `sigma_m`."""
        T = self.library.align_points_to_map(
            xyz, voxels.library, rigid(T_guess), REACH * sigma_m, sigma_m
        )
        return rigid(np.asarray(T, np.float64))


def map_with(kiss: Kiss, xyz: Float64) -> VoxelMap:
    """A map that has these points (M, 3) of another one with the same settings."""
    voxels = kiss.voxel_map()
    voxels.library.add_points(np.ascontiguousarray(xyz))
    return voxels


def threshold_after(kiss: Kiss, learnt: Float64) -> Threshold:
    """A threshold that has learnt from predictions that were off by so much, (N, 4, 4)."""
    threshold = kiss.threshold()
    for T_predicted_found in learnt:
        threshold.learn(T_predicted_found)
    return threshold


def point_to_point() -> PointToPoint:
    """Point to point ICP, on one thread: the same result every time."""
    from kiss_icp.registration import Registration

    return PointToPoint(Registration(MOST_ITERATIONS, CONVERGED, max_num_threads=1))


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
