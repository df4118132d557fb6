"""Fits the smooth disparity error of a rig to pixels whose true disparity is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.refine_fit import (
    CORRECTION_TERMS,
    PITCH,
    block_medians,
    coefficients,
    covariance_inside_frames,
    residual,
    some_of,
)
from pseudolidar.calibration.refine_terms import Choice, choose_terms, parts_of, tells_pitch
from pseudolidar.errors import CalibrationValue
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.correction import DisparityCorrection, SigmaScale
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE
from pseudolidar.structures.samples import MRAD, DisparitySamples

# Fewer than this cannot tell ten coefficients from noise that is correlated over some pixels.
MIN_SAMPLES = 500
# Of 1.8 million samples of KITTI stereo 2015, so many give the same correction to
# 0.03 px anywhere.
MAX_SAMPLES = 100_000
# A single frame cannot show how frames differ; KITTI frames drift by 0.1-0.2 px against each other.
ONE_FRAME_RESIDUAL_PX = 0.2
# A pitch of the LiDAR that is smaller than so many of its standard deviations is none.
PITCH_SIGMAS = 2.0
# Disparities that have a factor on sigma of their own, px: octaves.
SIGMA_BANDS_PX = (8.0, 16.0, 32.0)
# A matcher is not taken to be surer than this share of its sigma, whatever the systematic error
# covers.
LEAST_SIGMA_SCALE = 0.25


@dataclass(frozen=True, eq=False)
class Refinement:
    """A fitted correction and how it was chosen.

    Args:
        correction: what to take off, with its uncertainty.
        choice: the terms that were tried.
        samples: pixels that were used.
        frames: of so many frames.
        lidar_pitch_rad: how far the LiDAR of the reference is placed pitched down too much.
        lidar_pitch_sigma_rad: one standard deviation of that.
    """

    correction: DisparityCorrection
    choice: Choice
    samples: int
    frames: int
    lidar_pitch_rad: float
    lidar_pitch_sigma_rad: float

    @property
    def corrects(self) -> bool:
        """Whether there is anything that the correction takes off."""
        return bool(self.correction.coefficients.any())


def fit(samples: DisparitySamples, *, origin: str = "") -> DisparityCorrection:
    """The correction of `refined` alone."""
    return refined(samples, origin=origin).correction


def refined(
    samples: DisparitySamples,
    *,
    origin: str = "",
    fitted_m: tuple[float, float] | None = None,
) -> Refinement:
    """Fit the systematic disparity error of a rig, robust to wrong matches.

    Maximises the Cauchy likelihood of `measured - reference - c . phi(measured, u, v)`, each sample
    as sure as its sigma says, with a weak prior that pulls coefficients to zero which the samples
    do not determine. How many terms it has is decided by frames outside the fit. `residual_px` is
    what such a correction leaves on frames it was not fitted to: 68 % of the medians of image
    blocks lie within it. Pixel noise averages out there and belongs to the matcher's sigma, which
    `sigma_scale` makes fit the errors of frames left out. The covariance is that over frames.

    Args:
        samples: of as many frames as possible; pixels of all columns, rows and disparities.
        origin: what the samples are, in words; kept with the correction.
        fitted_m: nearest and farthest depth of the samples; kept likewise.

    Raises:
        CalibrationValue: too few samples.

    Source: measured on KITTI stereo 2015; iteratively reweighted least squares: Holland & Welsch
        1977; the simplest model within one standard error: Breiman et al. 1984.
    """
    samples = _usable(samples)
    frames = len(np.unique(samples.frame))
    if len(samples) < MIN_SAMPLES:
        raise CalibrationValue(
            f"{len(samples)} samples of {frames} frame(s)",
            want=f"at least {MIN_SAMPLES} pixels with a known disparity",
            fix="Take more frames, or frames with more of the reference in view.",
            where="correction",
        )
    thinned = some_of(samples, MAX_SAMPLES)
    choice, found, held = _solved(thinned, pitch=tells_pitch(thinned))
    if abs(found[PITCH]) < PITCH_SIGMAS * np.sqrt(held.covariance[PITCH, PITCH]):
        choice, found, held = _solved(thinned, pitch=False)
    rig = slice(CORRECTION_TERMS)
    correction = DisparityCorrection(
        found[rig],
        held.residual_px,
        origin or f"{len(samples)} samples of {frames} frames",
        held.sigma_scale,
        held.covariance[rig, rig],
        fitted_m,
    )
    pitch_rad, sigma_rad = MRAD * found[PITCH], MRAD * np.sqrt(held.covariance[PITCH, PITCH])
    return Refinement(correction, choice, len(samples), frames, float(pitch_rad), float(sigma_rad))


def _solved(samples: DisparitySamples, *, pitch: bool) -> tuple[Choice, Float64, _HeldOut]:
    choice = choose_terms(samples, pitch=pitch)
    found = coefficients(samples, choice.chosen.terms)
    return choice, found, _HeldOut.of(samples, choice.chosen.terms, found)


def _usable(samples: DisparitySamples) -> DisparitySamples:
    usable = np.isfinite(samples.measured) & np.isfinite(samples.reference)
    usable &= samples.measured > 0
    if samples.sigma is not None:
        usable &= np.isfinite(samples.sigma) & (samples.sigma > 0)
    return samples[usable]


@dataclass(frozen=True, eq=False)
class _HeldOut:
    """What fits say about parts that they were not fitted to.

    Args:
        residual_px: systematic error left, one standard deviation.
        sigma_scale: factors on the matcher's sigma.
        covariance: (11, 11) of the coefficients, by the jackknife.
    """

    residual_px: float
    sigma_scale: SigmaScale
    covariance: Float64

    @classmethod
    def of(cls, samples: DisparitySamples, terms: tuple[int, ...], whole: Float64) -> _HeldOut:
        """Fit without each part in turn; `whole` (11,) is the fit to all.

        A few frames look more alike than the frames to come, so that n of them show too little of
        what differs: by 1 + 1/n (measured on KITTI stereo 2015: fits to 1, 3, 5 and 11 frames,
        claims 0.66, 0.27, 0.26, 0.25 px, found on the 11 other frames 0.61, 0.39, 0.29, 0.29 px).

        The covariance is that of the jackknife over the parts, and no less than that of the noise
        inside frames in any direction: the parts are too few for ten coefficients. Fits to
        disjoint sets of frames of KITTI stereo 2015 differ by 0.9 to 1.05 times what either says.
        """
        frames, part = len(np.unique(samples.frame)), parts_of(samples)
        medians: list[float] = []
        errors, fits = np.empty(len(samples)), []
        turns = np.unique(part)
        for turn in turns:
            held = part == turn
            rest = samples if held.all() else samples[~held]
            fits.append(coefficients(rest, terms, start=whole))
            medians += block_medians(samples[held], fits[-1])
            errors[held] = residual(samples[held], fits[-1])
        least = ONE_FRAME_RESIDUAL_PX if frames == 1 else 0.0
        residual_px = max(least, (1 + 1 / frames) * _one_sigma(medians))
        spread = np.array(fits) - np.mean(fits, axis=0)
        between = (len(turns) - 1) / len(turns) * spread.T @ spread
        inside = covariance_inside_frames(samples, terms, whole)
        covariance = _larger_covariance(between, inside, terms)
        return cls(residual_px, _sigma_scale(samples, errors, residual_px), covariance)


def _larger_covariance(one: Float64, least: Float64, terms: tuple[int, ...]) -> Float64:
    """(11, 11) `one`, widened to `least` in every direction of the terms where it is narrower."""
    covariance = np.zeros_like(one)
    if not terms:
        return covariance
    chosen = np.ix_(terms, terms)
    root = np.linalg.cholesky(least[chosen])
    inverse = np.linalg.inv(root)
    sizes, axes = np.linalg.eigh(inverse @ one[chosen] @ inverse.T)
    widened = root @ axes
    covariance[chosen] = (widened * np.maximum(sizes, 1.0)) @ widened.T
    return covariance


def _sigma_scale(samples: DisparitySamples, error_px: Float64, systematic_px: float) -> SigmaScale:
    """Factors on sigma so that 68.27 % of the errors lie within it and the systematic error.

    |e|^2 <= (k sigma)^2 + systematic^2 holds for k >= sqrt(|e|^2 - systematic^2) / sigma. Each band
    of disparities with enough samples has one, at its median disparity.
    """
    if samples.sigma is None:
        return SigmaScale()
    beyond = np.sqrt(np.maximum(error_px**2 - systematic_px**2, 0.0)) / samples.sigma
    band = np.digitize(samples.measured, SIGMA_BANDS_PX)
    bands = [band == number for number in np.unique(band)]
    bands = [inside for inside in bands if inside.sum() >= MIN_SAMPLES] or [band == band]
    factors = [float(np.quantile(beyond[inside], ONE_SIGMA_SHARE)) for inside in bands]
    return SigmaScale(
        np.array([float(np.median(samples.measured[inside])) for inside in bands]),
        np.maximum(factors, LEAST_SIGMA_SCALE),
    )


def _one_sigma(medians: list[float]) -> float:
    return float(np.quantile(np.abs(medians), ONE_SIGMA_SHARE)) if medians else 0.0
