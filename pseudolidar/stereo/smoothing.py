"""From winners to a smooth disparity map with sigma."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pseudolidar.stereo import smoothing_kernels as kernels
from pseudolidar.stereo.aggregation import Winners
from pseudolidar.stereo.sigma_model import SigmaModel
from pseudolidar.structures.arrays import Bool, Float32, Float64
from pseudolidar.structures.disparity import DisparityMap

_MEDIAN_SIZE = 5


@dataclass(frozen=True, eq=False)
class Evidence:
    """Smoothed disparities and what tells of their errors; all (H, W) float32.

    Args:
        disparity: px, not positive where there is none.
        support: valid pixels in the 7x7 window.
        same: those on the same surface.
        spread: sum of deviations of the valid ones from the centre, px.
        distinctness: of the winner, (second best sum - best) / (best + 1).
    """

    disparity: Float32
    support: Float32
    same: Float32
    spread: Float32
    distinctness: Float32

    def with_sigma(self, model: SigmaModel) -> DisparityMap:
        """The disparity map with sigma by `model`."""
        values, sigma = self.disparity.copy(), np.empty_like(self.disparity)
        kernels.sigma(
            values,
            self.support,
            self.same,
            self.spread,
            self.distinctness,
            model.as_array(),
            sigma,
        )
        return DisparityMap(values, sigma)

    def features(self, where: Bool) -> Float64:
        """(N, 5) features of `SigmaModel` at valid pixels chosen by `where` (H, W)."""
        d, n, k, s, u = (np.asarray(a[where], np.float64) for a in vars(self).values())
        window = (2 * kernels.SMOOTHING_RADIUS + 1) ** 2
        spread = np.log2(kernels.SPREAD_FLOOR_PX + s / n)
        distinct = np.log2(np.maximum(u, kernels.DISTINCT_FLOOR))
        return np.stack([n / window, k / n, np.log2(d), spread, distinct], axis=-1)


def smoothed(winners: Winners, *, speckle_pixels: int, speckle_step_px: float) -> Evidence:
    """Median, acceptance, speckle removal and masked mean of what aggregation decided.

    Args:
        winners: of the aggregation.
        speckle_pixels: smaller segments are removed.
        speckle_step_px: largest step inside a segment, px.
    """
    median: Float32 = np.asarray(cv2.medianBlur(winners.disparity, _MEDIAN_SIZE), np.float32)
    valid = kernels.accept(median, winners.verdict)
    kernels.remove_speckles(median, valid, speckle_step_px, speckle_pixels)
    r = kernels.SMOOTHING_RADIUS
    height, width = median.shape
    padded = np.full((height + 2 * r, width + 2 * r), kernels.NONE, np.float32)
    np.copyto(padded[r : r + height, r : r + width], median, where=valid)
    mean, support, same, spread = (np.empty_like(median) for _ in range(4))
    kernels.smooth(padded, mean, support, same, spread)
    return Evidence(mean, support, same, spread, winners.distinctness)
