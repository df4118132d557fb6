"""One figure for how good a disparity map is, errors and gaps together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.disparity import disparity_errors, outliers
from pseudolidar.geometry.gaps import filled
from pseudolidar.structures.arrays import Bool, Float32, Float64
from pseudolidar.structures.disparity import DisparityMap

# What a pixel costs. An outlier by the rule of D1 costs 1. What is right costs by its error, in
# proportion up to 3 px, but never more than a gap: to leave it out must not pay. A gap costs half
# an outlier where filling it makes one, for who leaves it out has not lied. Of 29 settings of
# census each on KITTI stereo 2015 and Middlebury's motorcycle, this ranks as D1 with gaps filled
# and outliers with gaps at 0.15 together do (Spearman 0.95 and 0.95). Errors up to 3 px in
# proportion to 1 with every gap at 0.2 did not (-0.16, 0.48): an error of 0.6 px cost a gap, so
# sparse maps won.
RIGHT_COST, GAP_COST, WRONG_GAP_COST = 0.1, 0.1, 0.5
RIGHT_PX = 3.0
# Reference pixels that an octave of disparities needs for its offset to be known.
LEAST_PIXELS = 200
OCTAVES = 12


@dataclass(frozen=True)
class Judgement:
    """How good a map of one frame is.

    Args:
        loss: mean cost of a pixel, 0 to 1; by pairs alone something like it.
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
    costs = _costs(found[known], filled(found)[known], true_px[known])
    loss = float(costs.mean(dtype=np.float64))
    return Judgement(loss, errors.density, errors.d1_est, errors.d1_filled)


def _costs(found: Float32, dense: Float32, true_px: Float32) -> Float32:
    """(N,) what each pixel costs."""
    off = np.abs(found - true_px)
    right = np.float32(RIGHT_COST) * np.minimum(off / np.float32(RIGHT_PX), 1)
    matched = np.where(outliers(off, true_px), np.float32(1), right)
    wrong = outliers(np.abs(dense - true_px), true_px)
    gaps = np.where(wrong, np.float32(WRONG_GAP_COST), np.float32(GAP_COST))
    return np.where(np.isfinite(found), matched, gaps)


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
