"""Disparity error along the columns of the image and along disparity: where a rig's bias shows."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from pseudolidar.evaluation.comparison.points import ComparedPoints
from pseudolidar.structures.arrays import Float64

# Strips of the image, and edges of disparity that grow by about 1.4 (KITTI: 78 m to 3 m).
STRIPS = 16
DISPARITY_EDGES_PX = (0, 4, 6, 8, 11, 16, 23, 32, 45, 64, 91, 128, 181, 256)


@dataclass(frozen=True)
class DisparityErrorBin:
    """Disparity error of one strip or band; None where it is empty.

    Args:
        from_px: where it begins, inclusive.
        to_px: where it ends, exclusive.
        n: points.
        median_px: signed median; > 0 where the disparity is too large, the point too near.
        median_abs_px: median absolute error.
        quartiles_px: the middle half of the signed errors.
    """

    from_px: int
    to_px: int
    n: int
    median_px: float | None
    median_abs_px: float | None
    quartiles_px: tuple[float, float] | None

    def as_dict(self) -> dict[str, Any]:
        """The fields."""
        quartiles = None if self.quartiles_px is None else list(self.quartiles_px)
        return {**vars(self), "quartiles_px": quartiles}


def error_by_column(points: ComparedPoints, width_px: int) -> tuple[DisparityErrorBin, ...]:
    """Disparity error in strips of the image.

    Args:
        points: of images that may differ in width.
        width_px: that the strips are told in.
    """
    edges = [round(width_px * strip / STRIPS) for strip in range(STRIPS + 1)]
    return _binned(points, points.column * (width_px - 1), edges)


def error_by_disparity(points: ComparedPoints) -> tuple[DisparityErrorBin, ...]:
    """Disparity error by the disparity that the reference calls for."""
    return _binned(points, points.reference_px, DISPARITY_EDGES_PX)


def _binned(
    points: ComparedPoints, place: Float64, edges: list[int] | tuple[int, ...]
) -> tuple[DisparityErrorBin, ...]:
    known = np.isfinite(points.error_px)
    error, place = points.error_px[known], place[known]
    return tuple(
        _bin(low, high, error[(place >= low) & (place < high)]) for low, high in pairwise(edges)
    )


def _bin(low: int, high: int, error_px: Float64) -> DisparityErrorBin:
    if not len(error_px):
        return DisparityErrorBin(low, high, 0, None, None, None)
    lower, median, upper = map(float, np.quantile(error_px, (0.25, 0.5, 0.75)))
    size = float(np.median(np.abs(error_px)))
    return DisparityErrorBin(low, high, len(error_px), median, size, (lower, upper))
