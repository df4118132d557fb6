"""One robust fit of a disparity correction with some of its terms."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pseudolidar.structures.arrays import Bool, Float64, Int64
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE
from pseudolidar.structures.samples import DisparitySamples

# Half width of a Cauchy distribution that has 68.27 % of its mass within one sigma: matching errors
# have tails as heavy, and a wider one lets them pull far depths (KITTI stereo 2015, 50-80 m, frames
# left out: bias -3.2 % with 2.385, the constant that is efficient on Gaussian noise, -0.9 % so).
CAUCHY_PER_SIGMA = 0.55
# Noise below this is numerical, px; it keeps the weights defined on perfect data.
MIN_SCALE_PX = 1e-3
# How large the coefficients of a rig are expected to be, one standard deviation, px (KITTI 0.5-1),
# and the pitch of a LiDAR that its calibration left, mrad.
PRIOR_PX = 1.0
# Terms of a fit: those of the correction, then the pitch that the LiDAR of the reference has beyond
# what is known, mrad. Where it looks too low, what rises from the ground towards the camera seems
# nearer than the reference and what stands upright does not.
CORRECTION_TERMS = DisparityCorrection.TERMS
PITCH = CORRECTION_TERMS
TERMS = CORRECTION_TERMS + 1
# Errors of neighbouring pixels are correlated: a frame is taken to tell as much as so many
# independent ones, those of patches of about 50 x 50 px in the half of a KITTI image with truth.
INDEPENDENT_PER_FRAME = 100
MAX_ITERATIONS, CONVERGED_PX = 50, 1e-4
# Medians of blocks of a frame: columns of the image times bands of disparity, px.
BLOCK_COLUMNS, BLOCK_BANDS_PX = 4, (0.0, 10.0, 20.0, 40.0, np.inf)
# What rises towards the camera, as the ground does, and what stands upright are blocks of their
# own: px a mrad of pitch that divides them (ground of KITTI: 0.23).
RISES_PER_PITCH = 0.1
# Samples that a block must have: a fair share of its frame's, within these; a median of 20 errors
# of 0.4 px is known to 0.1 px, one of 200 to 0.04.
FEWEST_BLOCK_SAMPLES, ENOUGH_BLOCK_SAMPLES = 20, 200


def some_of(samples: DisparitySamples, most: int) -> DisparitySamples:
    """At most so many of the samples, by chance, always the same: steps would follow patterns."""
    if len(samples) <= most:
        return samples
    chosen = np.random.default_rng(0).choice(len(samples), most, replace=False)
    return samples[np.sort(chosen)]


def coefficients(
    samples: DisparitySamples, terms: tuple[int, ...], *, start: Float64 | None = None
) -> Float64:
    """(11,) most likely coefficients where errors are Cauchy-distributed, wide as sigma says.

    Args:
        samples: at least one.
        terms: the features that may be used; the coefficients of all others are 0.
        start: (11,) where to begin, of similar samples: saves iterations and changes nothing else.
    """
    return _solved(samples, terms, start)[0]


def covariance_inside_frames(
    samples: DisparitySamples, terms: tuple[int, ...], fitted: Float64
) -> Float64:
    """(11, 11) px^2 of the coefficients `fitted` (11,), by the noise inside the frames alone.

    A frame counts as `INDEPENDENT_PER_FRAME` samples, however many it has.
    """
    return _solved(samples, terms, fitted)[1]


def _solved(
    samples: DisparitySamples, terms: tuple[int, ...], start: Float64 | None
) -> tuple[Float64, Float64]:
    found, spread_of_found = np.zeros(TERMS), np.zeros((TERMS, TERMS))
    if not terms:
        return found, spread_of_found
    features = np.ascontiguousarray(_features(samples)[:, terms].T)
    error = samples.measured - samples.reference
    spread = np.ones_like(error) if samples.sigma is None else samples.sigma
    precision = 1.0 / spread**2
    independent = INDEPENDENT_PER_FRAME * len(np.unique(samples.frame))
    sizes = np.zeros(len(terms))
    if start is not None:
        sizes = start[list(terms)]
    elif terms[0] == 0:
        sizes[0] = np.median(error)
    for _ in range(MAX_ITERATIONS):
        ratio = np.abs(error - np.einsum("i,in->n", sizes, features)) / spread
        scale = max(MIN_SCALE_PX, float(np.quantile(ratio, ONE_SIGMA_SHARE)))
        weight = precision / (1.0 + (ratio / (CAUCHY_PER_SIGMA * scale)) ** 2)
        weighted = features * (weight / weight.sum())
        noise = scale**2 / (precision.mean() * independent)
        # no BLAS: with more threads than free cores it waits longer than it computes
        normal = np.einsum("in,jn->ij", weighted, features)
        normal += noise / PRIOR_PX**2 * np.eye(len(sizes))
        updated = np.linalg.solve(normal, np.einsum("in,n->i", weighted, error))
        change = np.abs(updated - sizes).max()
        sizes = updated
        if change < CONVERGED_PX:
            break
    found[list(terms)] = sizes
    spread_of_found[np.ix_(terms, terms)] = noise * np.linalg.inv(normal)
    return found, spread_of_found


def residual(samples: DisparitySamples, fitted: Float64) -> Float64:
    """(N,) px, errors that are left with the coefficients `fitted` (11,)."""
    fitted_px = np.einsum("ni,i->n", _features(samples), fitted)
    return np.asarray(samples.measured - fitted_px - samples.reference)


def block_columns(samples: DisparitySamples) -> Int64:
    """(N,) quarter of the image that each sample lies in."""
    return (samples.u * BLOCK_COLUMNS / samples.size_px[0]).astype(np.int64)


def rising(samples: DisparitySamples) -> Bool:
    """(N,) samples of what rises towards the camera; none where nothing is known of it."""
    if samples.per_pitch is None:
        return np.zeros(len(samples), np.bool_)
    return np.asarray(np.abs(samples.per_pitch) > RISES_PER_PITCH)


def block_medians(samples: DisparitySamples, fitted: Float64) -> Iterator[float]:
    """Median error left of each block of a frame that has enough samples, px; weighed by sigma.

    Where none has, the median of all samples, at least one.
    """
    left = residual(samples, fitted)
    weight = np.ones_like(left) if samples.sigma is None else samples.sigma**-2.0
    band = np.digitize(samples.reference, BLOCK_BANDS_PX)
    block = samples.frame * BLOCK_COLUMNS + block_columns(samples)
    block = 2 * (block * (len(BLOCK_BANDS_PX) + 1) + band) + rising(samples)
    share = len(samples) / len(np.unique(samples.frame)) / BLOCK_COLUMNS / (len(BLOCK_BANDS_PX) - 1)
    enough = min(max(share, FEWEST_BLOCK_SAMPLES), ENOUGH_BLOCK_SAMPLES)
    order = np.argsort(block, kind="stable")
    blocks = np.split(order, np.flatnonzero(np.diff(block[order])) + 1)
    large = [inside for inside in blocks if len(inside) >= enough]
    for inside in large or [order]:
        yield _weighted_median(left[inside], weight[inside])


def _weighted_median(values: Float64, weights: Float64) -> float:
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(share, share[-1] / 2)])


def _features(samples: DisparitySamples) -> Float64:
    """(N, 11): what errors are made of, for a coefficient of 1 each."""
    rig = DisparityCorrection.features(samples.measured, samples.u, samples.v, samples.size_px)
    pitch = np.zeros(len(samples)) if samples.per_pitch is None else samples.per_pitch
    return np.column_stack([rig, pitch])
