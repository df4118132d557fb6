"""A cloud of a street, far from the origin of its frame, as maps of the world are."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.cloud import PointCloud

UTM_M = np.array([4.5e5, 5.4e6, 110.0])
COUNT = 120_000


def street(count: int = COUNT) -> PointCloud:
    rng = np.random.default_rng(3)
    xyz = UTM_M + rng.uniform((-40, -40, 0), (40, 40, 0.2), (count, 3))
    return PointCloud(
        xyz,
        "map",
        rgb=rng.integers(0, 255, (count, 3), dtype=np.uint8),
        sigma_m=rng.random(count, np.float32),
        extra={"time_s": np.arange(count), "nx": np.zeros(count, np.float32)},
    )
