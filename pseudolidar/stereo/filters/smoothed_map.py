"""`--smooth fgs`: disparity maps smoothed along surfaces, guided by the picture and by sigma."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StereoConfig
from pseudolidar.stereo.filters.map_filter import Filtered, picture8, sigma_or_usual
from pseudolidar.structures.arrays import Bool, Float32
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Confidence of a pixel is 1 / (1 + (sigma / this)^2): surer ones than this are sure. Flat from 0.3
# to 0.5 px on KITTI stereo 2015.
SURE_PX = 0.3
# In a dense map the background of its row stands in for a pixel without a match, trusted so much.
BACKGROUND_CONFIDENCE = 0.3
# A matched pixel is moved by at most so many of its sigmas: beyond, the smoother would overrule a
# measurement that it cannot judge. D1 on KITTI stereo 2015: 2.71 % without limit, 2.50 % with it.
LARGEST_MOVE_SIGMAS = 1.0
# A pixel without a match lies this near to the background of its row, px: between two surfaces what
# is smooth is neither. D1 of dense maps with 1 px and without limit, the row's background alone in
# brackets, 2026-11-26: KITTI stereo 2015 4.72 and 4.73 % (4.90), Middlebury's motorcycle 6.52 and
# 6.60 % (6.66), with SGBM 7.59 and 7.70 % (7.94), 9.45 and 10.15 % (9.57).
LARGEST_MOVE_UNMATCHED_PX = np.float32(1.0)
# Sigma of a pixel without a match: shares of its surroundings' sigma and of the distance of the
# smooth surface from the background, and px a pixel from the next match.
# Fitted to KITTI stereo 2015, Student-t likelihood scaled to 68 %, 2026-11-25.
SURROUNDINGS_SHARE, BACKGROUND_SHARE, GROWTH_PX = 1.3, 0.95, 0.045


@dataclass(frozen=True)
class Fgs:
    """Edge-aware smoothing by the fast global smoother, along slanted surfaces too.

    Args:
        strength: lambda of the weighted least squares; larger reaches farther.
        sigma_color: difference of colours, in grey levels, that counts as an edge.
        dense: give every pixel a disparity, also where there was no match; by default only
            matched pixels are smoothed.
    """

    strength: float = 8000.0
    sigma_color: float = 1.5
    dense: bool = False

    def __post_init__(self) -> None:
        for name in ("strength", "sigma_color"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise StereoConfig(f"{name} = {value:g}", want="a positive number")

    def load(self) -> FgsFilter:
        """The filter, its kernels compiled or read from the cache."""
        from pseudolidar.stereo.filters import fgs  # noqa: F401  kernels are made on import

        return FgsFilter(self)


@dataclass(frozen=True)
class FgsFilter:
    """A loaded `Fgs`."""

    settings: Fgs

    def __call__(self, frame: StereoFrame, disparity: DisparityMap) -> Filtered:
        """Smooth the map.

        Sigma of a matched pixel is its own and how far it was moved, root of the sum of squares.
        Pixels of a dense map without a match have a larger one; its tails are heavy (on KITTI 87 %
        instead of 95 % lie within the 95 % radius). A map without sigma is trusted evenly and
        stays without.
        """
        from pseudolidar.stereo.filters.fgs import smooth_surfaces

        s, valid = self.settings, disparity.valid
        if not valid.any():
            return Filtered(disparity, {})
        sigma = sigma_or_usual(disparity)
        confidence = np.where(valid, 1 / (1 + (sigma / np.float32(SURE_PX)) ** 2), np.float32(0))
        values, around = disparity.values, sigma
        if s.dense:
            confidence[~valid] = BACKGROUND_CONFIDENCE
            values, around = _background(values, valid), _background(sigma, valid)
        smooth, sigma_around = smooth_surfaces(
            values,
            confidence,
            picture8(frame),
            *([around] if s.dense else [values]),
            strength=s.strength,
            sigma_color=s.sigma_color,
        )
        limit = np.float32(LARGEST_MOVE_SIGMAS) * sigma
        moved = np.clip(smooth - disparity.values, -limit, limit)
        out, out_sigma = disparity.values + moved, np.hypot(sigma, moved)
        if s.dense:
            background = _background(out, valid)
            most = LARGEST_MOVE_UNMATCHED_PX
            out[~valid] = (background + np.clip(smooth - background, -most, most))[~valid]
            out_sigma[~valid] = _unmatched_sigma(smooth, values, sigma_around, valid)[~valid]
            out_sigma[~(out > 0)] = np.nan
            out[~(out > 0)] = np.nan
        counts = {
            "pixels_smoothed": int(np.count_nonzero(moved[valid])),
            "pixels_filled_by_smoothing": int(np.count_nonzero(np.isfinite(out) & ~valid)),
        }
        return Filtered(DisparityMap(out, None if disparity.sigma is None else out_sigma), counts)


def _background(values: Float32, valid: Bool) -> Float32:
    """Gaps filled by the smaller of the row's next values, in rows without any from rows around."""
    columns = np.arange(values.shape[1])
    before = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    after = np.where(valid, columns, len(columns))[:, ::-1]
    after = np.minimum.accumulate(after, axis=1)[:, ::-1]
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    rows = np.arange(len(values))[:, None]
    smaller = np.minimum(padded[rows, before + 1], padded[rows, after + 1])
    known = np.flatnonzero(valid.any(axis=1))
    nearest = np.maximum(np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0)
    return np.asarray(smaller[known[nearest]])


def _unmatched_sigma(smooth: Float32, background: Float32, around: Float32, valid: Bool) -> Float32:
    import cv2

    away = cv2.distanceTransform((~valid).astype(np.uint8), cv2.DIST_L2, 3)
    parts = (
        np.float32(SURROUNDINGS_SHARE) * around,
        np.float32(BACKGROUND_SHARE) * (smooth - background),
        np.float32(GROWTH_PX) * away,
    )
    return np.asarray(np.sqrt(sum(part * part for part in parts)), np.float32)
