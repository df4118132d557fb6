"""Correction and sigma judged on frames that they were not fitted to: halves, swapped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.ranges import RangeErrors, errors_by_range
from pseudolidar.evaluation.sigma import (
    SigmaShares,
    fit_scale,
    sigma_shares,
    sigma_shares_by_range,
    sparsification_error,
    total_sigma,
)
from pseudolidar.geometry.triangulation import corrected_disparity, depth_from_disparity
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.samples import DisparitySamples


@dataclass(frozen=True, eq=False)
class FrameSamples:
    """Pixels of one frame whose true disparity is known.

    Args:
        samples: measured and true, uncorrected.
        rig: of the frame; its own correction is not used.
    """

    samples: DisparitySamples
    rig: StereoRig


@dataclass(frozen=True, eq=False)
class Residuals:
    """Errors of corrected disparities, pooled over pixels.

    Args:
        error_px: (N,) corrected minus true.
        depth_m: (N,) Z of the corrected disparity; NaN beyond infinity.
        true_depth_m: (N,) Z of the true one.
        sigma_px: (N,) the matcher's sigma as it is, or None.
        total_px: (N,) sigma of the disparity, systematic error included, or None.
    """

    error_px: Float64
    depth_m: Float64
    true_depth_m: Float64
    sigma_px: Float64 | None
    total_px: Float64 | None

    def by_range(self) -> tuple[RangeErrors, ...]:
        """Relative depth errors."""
        return errors_by_range(self.depth_m, self.true_depth_m)

    def sigma_shares(self) -> SigmaShares | None:
        """How many errors the total sigma holds; None without sigma."""
        return None if self.total_px is None else sigma_shares(self.error_px, self.total_px)

    def sigma_by_range(self) -> Sequence[dict[str, object]]:
        """`sigma_shares` by true depth; empty without sigma."""
        if self.total_px is None:
            return ()
        return sigma_shares_by_range(self.error_px, self.total_px, self.true_depth_m)

    def sparsification_error(self) -> float | None:
        """AUSE of the matcher's sigma."""
        if self.sigma_px is None:
            return None
        return sparsification_error(self.error_px, self.sigma_px)

    @classmethod
    def concatenate(cls, parts: Sequence[Residuals]) -> Residuals:
        """All residuals; at least one part; sigma only where all parts have it."""
        sigmas = [part.sigma_px for part in parts if part.sigma_px is not None]
        totals = [part.total_px for part in parts if part.total_px is not None]
        return cls(
            error_px=np.concatenate([part.error_px for part in parts]),
            depth_m=np.concatenate([part.depth_m for part in parts]),
            true_depth_m=np.concatenate([part.true_depth_m for part in parts]),
            sigma_px=np.concatenate(sigmas) if len(sigmas) == len(parts) else None,
            total_px=np.concatenate(totals) if len(totals) == len(parts) else None,
        )


def residuals(
    frames: Sequence[FrameSamples], *, correction: DisparityCorrection | None, scale: float = 1.0
) -> Residuals:
    """Errors of `frames`, at least one, on their rigs with `correction`.

    Args:
        frames: what is judged.
        correction: systematic error to take off; None judges the rig as it came.
        scale: factor on the matcher's sigma.
    """
    return Residuals.concatenate([_residuals(frame, correction, scale) for frame in frames])


def _residuals(
    frame: FrameSamples, correction: DisparityCorrection | None, scale: float
) -> Residuals:
    samples, rig = frame.samples, frame.rig.with_correction(correction)
    corrected = corrected_disparity(samples.measured, samples.u, samples.v, rig)
    sigma = samples.sigma
    return Residuals(
        error_px=corrected - samples.reference,
        depth_m=depth_from_disparity(corrected, samples.u, rig),
        true_depth_m=depth_from_disparity(samples.reference, samples.u, rig),
        sigma_px=sigma,
        total_px=None
        if sigma is None
        else total_sigma(sigma, rig.systematic_sigma_px, scale=scale),
    )


@dataclass(frozen=True, eq=False)
class HalvesJudgement:
    """What correction and sigma are worth on frames outside their fit.

    Args:
        residuals: of all frames, each judged with what the other half gave.
        residual_px: systematic error that the two corrections claim to leave.
        scales: factors on the matcher's sigma that the two halves ask for; empty without sigma.
    """

    residuals: Residuals
    residual_px: tuple[float, float]
    scales: tuple[float, ...]


def judge_halves(
    frames: Sequence[FrameSamples], *, fit: Callable[[DisparitySamples], DisparityCorrection]
) -> HalvesJudgement | None:
    """Fit on even frames, judge odd ones, and swap; None for a single frame.

    Fitted are the rig's disparity correction and one factor on the matcher's sigma, so that 68 %
    of the errors lie within sigma with the systematic error included.

    Args:
        frames: in the order of the source.
        fit: makes a correction from samples.
    """
    even, odd = frames[0::2], frames[1::2]
    if not odd:
        return None
    judged, residual_px, scales = [], [], list[float]()
    for fitted, others in ((even, odd), (odd, even)):
        correction = fit(DisparitySamples.concatenate([frame.samples for frame in fitted]))
        own = residuals(fitted, correction=correction)
        scale = 1.0
        if own.sigma_px is not None:
            scale = fit_scale(own.error_px, own.sigma_px, correction.residual_px)
            scales.append(scale)
        judged.append(residuals(others, correction=correction, scale=scale))
        residual_px.append(correction.residual_px)
    return HalvesJudgement(
        Residuals.concatenate(judged), (residual_px[0], residual_px[1]), tuple(scales)
    )
