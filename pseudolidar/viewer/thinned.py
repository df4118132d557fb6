"""Clouds within a budget of points, the same ones from frame to frame."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.cloud import PointCloud

# A prime step through the points meets rows and columns of pixels evenly.
SEED = 7


def thinned(cloud: PointCloud, most: int) -> PointCloud:
    """At most so many of its points, spread evenly over their order; all where they fit.

    Args:
        cloud: any.
        most: at least 1.
    """
    if len(cloud) <= most:
        return cloud
    # One of each run of points, by chance within it: a fixed step would draw stripes into clouds
    # that are in the order of pixels.
    edges = np.linspace(0, len(cloud), most + 1)
    rng = np.random.default_rng(SEED)
    chosen = (edges[:-1] + rng.random(most) * np.diff(edges)).astype(np.int64)
    return cloud[np.minimum(chosen, len(cloud) - 1)]
