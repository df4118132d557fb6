"""Clouds within a budget of points, the same ones from frame to frame."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Bool, Int64
from pseudolidar.structures.cloud import PointCloud

# Of chance: the same for every frame, so that clouds of the same points do not flicker.
SEED = 7
# Of the budget for points that tell what is looked for; the others show where these are.
TELLING_SHARE = 0.75


def thinned(cloud: PointCloud, most: int, telling: Bool | None = None) -> PointCloud:
    """At most so many of its points, spread evenly over their order; all where they fit.

    Args:
        cloud: any.
        most: at least 1.
        telling: (N,) points that are taken first, up to their share; None where all are alike.
    """
    if len(cloud) <= most:
        return cloud
    if telling is None:
        return cloud[_some(len(cloud), most)]
    first, others = np.flatnonzero(telling), np.flatnonzero(~telling)
    first = first[_some(len(first), max(round(TELLING_SHARE * most), most - len(others)))]
    others = others[_some(len(others), most - len(first))]
    return cloud[np.sort(np.concatenate([first, others]))]


def _some(count: int, most: int) -> Int64:
    """At most so many of the first numbers, evenly spread."""
    if count <= most:
        return np.arange(count)
    # One of each run of points, by chance within it: a fixed step would draw stripes into clouds
    # that are in the order of pixels.
    edges = np.linspace(0, count, most + 1)
    rng = np.random.default_rng(SEED)
    chosen = (edges[:-1] + rng.random(most) * np.diff(edges)).astype(np.int64)
    return np.minimum(chosen, count - 1)
