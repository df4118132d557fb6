"""A cloud of at most so many points: those that are missed least are left out."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Bool, Float32, Int64
from pseudolidar.structures.cloud import PointCloud

# Steps of a point's threshold for a column and a row further on, in 2^32 parts of one: the plastic
# number's reciprocals, whose multiples fill the square more evenly than any random choice.
# Source: M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018 (R2).
COLUMN_STEP, ROW_STEP = np.uint32(3242174889), np.uint32(2447445414)
# The same along a line, where nothing is known of pixels: the golden ratio's.
INDEX_STEP = np.uint32(2654435769)
UNIT = np.float32(2.0**-32)


def thinned(cloud: PointCloud, most: int) -> PointCloud:
    """The cloud with at most `most` points, in their order, with all their columns.

    A pixel sees a patch of surface that grows with the square of the range: at 5 m neighbours
    stand 7 mm apart, at 50 m 70 mm (KITTI). So each point is kept with a chance in proportion to
    range^2, and among points of one range to their certainty in the image, range^2 / sigma: the
    far and the sure ones stay, surfaces close by lose what is sampled over and over. The chance
    reaches one at a certain range, beyond which all are kept; that range follows from `most`.

    What has a chance of one in three is every third point, evenly over the image: a point is kept
    where a threshold that its pixel has once and for all lies below its chance. So nothing is
    random, and a frame alone decides about its points.

    Args:
        cloud: its `uv` say which pixel a point is of, else its position counts; without `sigma_m`
            ranges alone do. Points without coordinates go first.
        most: how many points there may be, at least 0.
    """
    if len(cloud) <= most:
        return cloud
    return cloud[_largest(_merit(cloud), most)]


def _merit(cloud: PointCloud) -> Float32:
    """(N,) chance of each point, but for one factor, over its threshold; 0 without coordinates."""
    x, y, z = cloud.xyz.T.astype(np.float32, copy=False)
    area = x * x
    area += y * y
    area += z * z
    if cloud.sigma_m is not None:
        # range^2 / sigma is a constant over the error of the disparity.
        with np.errstate(divide="ignore", invalid="ignore"):
            area *= area / cloud.sigma_m
    area /= _threshold(cloud)
    area[np.isnan(area)] = 0
    return np.asarray(area, np.float32)


def _threshold(cloud: PointCloud) -> Float32:
    """(N,) numbers above 0 and up to 1, evenly spread over any part of the image."""
    with np.errstate(over="ignore"):
        if cloud.uv is not None:
            u, v = np.nan_to_num(cloud.uv.T).astype(np.int32).astype(np.uint32)
            parts = u * COLUMN_STEP + v * ROW_STEP
        else:
            parts = np.arange(len(cloud), dtype=np.uint32) * INDEX_STEP
    return np.asarray((parts.astype(np.float32) + np.float32(1.0)) * UNIT, np.float32)


def _largest(merit: Float32, most: int) -> Int64:
    """Positions of the `most` largest, in order; of equal ones the first."""
    if most == 0:
        return np.zeros(0, np.int64)
    least = np.partition(merit, len(merit) - most)[len(merit) - most]
    keep: Bool = merit > least
    equal = np.flatnonzero(merit == least)[: most - int(np.count_nonzero(keep))]
    keep[equal] = True
    return np.flatnonzero(keep)
