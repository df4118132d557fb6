"""Disparity errors as the KITTI stereo benchmark counts them: D1, density, EPE, bad-k."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ReferenceMissing, StructureError
from pseudolidar.geometry.gaps import filled
from pseudolidar.structures.arrays import Bool, Float32, Float64
from pseudolidar.structures.disparity import DisparityMap

# An outlier is off by more than both. Source: Menze & Geiger, Object Scene Flow for Autonomous
# Vehicles, CVPR 2015, section 6, and the devkit of KITTI stereo 2015.
D1_PX, D1_REL = 3.0, 0.05
BAD_PX = (1.0, 2.0, 3.0)


@dataclass(frozen=True)
class DisparityErrors:
    """Counts over the pixels of one frame that have a true disparity.

    Args:
        truth: pixels with a true disparity.
        matched: those of them that the estimate has.
        outliers: matched pixels that are D1 outliers.
        outliers_filled: pixels of `truth` that are D1 outliers once gaps are filled.
        bad: matched pixels that are off by more than each of `BAD_PX`.
        absolute_px: sum of the absolute errors of matched pixels.
    """

    truth: int
    matched: int
    outliers: int
    outliers_filled: int
    bad: tuple[int, ...]
    absolute_px: float

    @property
    def d1_est(self) -> float | None:
        """Share of outliers among matched pixels: error > 3 px and > 5 % of the truth."""
        return self.outliers / self.matched if self.matched else None

    @property
    def density(self) -> float:
        """Share of the pixels with truth that the estimate has."""
        return self.matched / self.truth

    @property
    def d1_filled(self) -> float:
        """Share of outliers among all pixels with truth, gaps filled by `filled`."""
        return self.outliers_filled / self.truth

    @property
    def epe(self) -> float | None:
        """Mean absolute error of matched pixels, px."""
        return self.absolute_px / self.matched if self.matched else None

    def bad_share(self, threshold_px: float) -> float | None:
        """Share of matched pixels off by more than `threshold_px`, one of `BAD_PX`."""
        return self.bad[BAD_PX.index(threshold_px)] / self.matched if self.matched else None


def disparity_errors(estimate: DisparityMap, truth: DisparityMap) -> DisparityErrors:
    """Compare a disparity map with the truth.

    Raises:
        StructureError: the maps differ in size.
        ReferenceMissing: no pixel has a true disparity.
    """
    if estimate.values.shape != truth.values.shape:
        raise StructureError(
            f"an estimate of shape {estimate.values.shape}",
            want=f"{truth.values.shape}, the shape of the truth",
        )
    known = truth.valid
    if not known.any():
        raise ReferenceMissing("a truth without a single known disparity")
    true_px = truth.values[known].astype(np.float64)
    matched = estimate.valid[known]
    error_px = np.abs(estimate.values[known][matched] - true_px[matched])
    error_filled_px = np.abs(filled(estimate.values)[known] - true_px)
    return DisparityErrors(
        truth=len(true_px),
        matched=len(error_px),
        outliers=int(outliers(error_px, true_px[matched]).sum()),
        outliers_filled=int(outliers(error_filled_px, true_px).sum()),
        bad=tuple(int((error_px > threshold).sum()) for threshold in BAD_PX),
        absolute_px=float(error_px.sum()),
    )


def outliers(error_px: Float64 | Float32, true_px: Float64 | Float32) -> Bool:
    """D1 outliers; a pixel that even filling left empty (NaN) is one."""
    return ~(error_px <= D1_PX) & ~(error_px <= D1_REL * true_px)


@dataclass(frozen=True)
class DisparityScore:
    """Errors of a set of frames.

    Args:
        frames: of each frame, at least one.

    The headline figures are means of the frames' figures: so the tables were made that this
    project compares with. `pooled` counts every pixel once instead.
    """

    frames: Sequence[DisparityErrors]

    @property
    def pooled(self) -> DisparityErrors:
        """The same counts over the pixels of all frames."""
        each = self.frames
        return DisparityErrors(
            truth=sum(frame.truth for frame in each),
            matched=sum(frame.matched for frame in each),
            outliers=sum(frame.outliers for frame in each),
            outliers_filled=sum(frame.outliers_filled for frame in each),
            bad=tuple(sum(counts) for counts in zip(*(f.bad for f in each), strict=True)),
            absolute_px=sum(frame.absolute_px for frame in each),
        )

    @property
    def d1_est(self) -> float | None:
        """Mean over frames of their share of D1 outliers among matched pixels."""
        return mean_known([frame.d1_est for frame in self.frames])

    @property
    def density(self) -> float:
        """Mean over frames of the share of pixels with truth that are matched."""
        return float(np.mean([frame.density for frame in self.frames]))

    @property
    def d1_filled(self) -> float:
        """Mean over frames of their share of D1 outliers, gaps filled."""
        return float(np.mean([frame.d1_filled for frame in self.frames]))

    @property
    def epe(self) -> float | None:
        """Mean over frames of their mean absolute error, px."""
        return mean_known([frame.epe for frame in self.frames])

    def bad_share(self, threshold_px: float) -> float | None:
        """Mean over frames of their share of matched pixels off by more than `threshold_px`."""
        return mean_known([frame.bad_share(threshold_px) for frame in self.frames])


def mean_known(values: Sequence[float | None]) -> float | None:
    """Mean of the values that are not None; None if there is none."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
