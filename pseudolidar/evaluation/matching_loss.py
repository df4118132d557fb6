"""One figure for how good a disparity map is, errors and gaps together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.disparity import disparity_errors
from pseudolidar.structures.arrays import Bool, Float32, Float64
from pseudolidar.structures.disparity import DisparityMap

# A pixel that is off by this much or more costs 1, by less in proportion.
MOST_PX = 3.0
# What a pixel without a disparity costs. Loosening the uniqueness of the default matcher on KITTI
# stereo 2015 adds pixels of which 12 to 15 % are outliers, beside errors of a fifth of a pixel: at
# this cost the defaults are about even with their neighbours, sparser or denser.
GAP_COST = 0.2
# Reference pixels that an octave of disparities needs for its offset to be known.
LEAST_PIXELS = 200
OCTAVES = 12


@dataclass(frozen=True)
class Judgement:
    """How good a map of one frame is.

    Args:
        loss: mean cost of a pixel, 0 to 1.
        density: share of the judged pixels that have a disparity.
        d1_est: share of D1 outliers among them; None where there is no reference.
        d1_filled: share of D1 outliers, gaps filled; likewise.
    """

    loss: float
    density: float
    d1_est: float | None = None
    d1_filled: float | None = None


def judged_by_reference(values: Float32, reference: Float32, rows: Bool) -> Judgement:
    """Compare a map with a reference.

    Args:
        values: (H, W) px, NaN where there is none.
        reference: (H, W) px, NaN where nobody knows.
        rows: (H,) rows that count.

    Raises:
        ReferenceMissing: there is no reference in these rows.
    """
    found, true_px = values[rows], reference[rows]
    known = np.isfinite(true_px)
    if not known.any():
        raise ReferenceMissing("no reference in the rows that are judged", want="some pixels")
    errors = disparity_errors(DisparityMap(found), DisparityMap(true_px))
    off = np.abs(found[known] - true_px[known])
    costs = np.where(np.isfinite(off), np.minimum(off / np.float32(MOST_PX), 1), GAP_COST)
    loss = float(costs.mean(dtype=np.float64))
    return Judgement(loss, errors.density, errors.d1_est, errors.d1_filled)


def as_the_rig_has_it(reference: Float32, measured: Float32) -> Float32:
    """The reference with what all matchers are off by: the error of the rig, not of settings.

    A stock rig is off by half a pixel, smoothly: medians over octaves of disparity tell. Without,
    noise would be judged by which side of zero it falls on.

    Args:
        reference: (H, W) px.
        measured: (H, W) px, by settings that are good.
    """
    octave = np.floor(np.log2(np.maximum(reference, 1)))
    off: Float64 = (measured - reference).astype(np.float64)
    shifted = reference.copy()
    for each in range(OCTAVES):
        inside = octave == each
        known = off[inside & np.isfinite(off)]
        if len(known) >= LEAST_PIXELS:
            shifted[inside] += np.float32(np.median(known))
    return shifted
