"""Gaps of disparity maps taken from what is beside them."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float32


def filled(values: Float32) -> Float32:
    """A map without gaps, by the rule of the KITTI devkit.

    Each gap of a row takes the smaller of its two horizontal neighbours (the background), at the
    border the only one. Rows without any value copy the nearest row above that has one, above the
    first such row the one below. No median, no smoothing.

    Args:
        values: (H, W) px, NaN = none.

    Returns:
        (H, W) px, NaN only if `values` has no value at all.

    Source: KITTI stereo 2015 devkit, `interpolateBackground`.
    """
    valid = np.isfinite(values)
    columns = np.arange(values.shape[1])
    before = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    after = np.where(valid, columns, len(columns))[:, ::-1]
    after = np.minimum.accumulate(after, axis=1)[:, ::-1]
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    smaller = np.minimum(
        np.take_along_axis(padded, before + 1, axis=1),
        np.take_along_axis(padded, after + 1, axis=1),
    )
    rows = np.flatnonzero(valid.any(axis=1))
    if not len(rows):
        return values.copy()
    nearest = np.maximum(np.searchsorted(rows, np.arange(len(values)), side="right") - 1, 0)
    return np.asarray(smaller[rows[nearest]])
