"""Systematic disparity error: medians over blocks of the image and of disparities, by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Float64, Int64

# Blocks: columns and rows of the image, and disparities that grow by about 1.4.
COLUMNS, ROWS = 8, 4
BANDS_PX = (1.5, 2.5, 4.0, 6.0, 9.0, 13.0, 18.0, 26.0, 36.0, 50.0, 72.0, 128.0)
# A block with fewer points says nothing; neighbouring points err alike, so many as one.
MIN_POINTS, ALIKE = 25, 15
# How well the median of a block can be known at best: matchers prefer some fractions of a pixel.
FLOOR_PX = 0.05
# Standard deviation of a median by that of a mean, of a normal distribution: sqrt(pi / 2).
MEDIAN_PER_MEAN = 1.2533


@dataclass(frozen=True, eq=False)
class ErrorBlocks:
    """Medians of blocks of frames.

    Args:
        u: (N,) column, px.
        v: (N,) row, px.
        reference_px: (N,) true disparity.
        error_px: (N,) measured, by the rig as it is, minus true.
        sigma_px: (N,) standard error of that median.
        slope_u: (N,) how disparities change along the columns, px a px; 0 where nothing is known.
        slope_v: (N,) along the rows.
        frame: (N,) number of the frame.
    """

    u: Float64
    v: Float64
    reference_px: Float64
    error_px: Float64
    sigma_px: Float64
    slope_u: Float64
    slope_v: Float64
    frame: Int64

    def __len__(self) -> int:
        return len(self.u)

    @classmethod
    def of(cls, table: Float64) -> ErrorBlocks:
        """Of the (N, 8) table of all columns."""
        u, v, reference, error, sigma, slope_u, slope_v, frame = table.T
        return cls(u, v, reference, error, sigma, slope_u, slope_v, frame.astype(np.int64))


def error_blocks(frames: Sequence[ComparedFrame]) -> ErrorBlocks:
    """Blocks of all frames with enough points in them."""
    rows = [row for number, frame in enumerate(frames) for row in _blocks(frame, number)]
    return ErrorBlocks.of(np.array(rows, np.float64).reshape(-1, 8))


def _blocks(frame: ComparedFrame, number: int) -> list[tuple[float, ...]]:
    width, height = frame.rig.left.size_px
    reference = frame.reference_px
    error = frame.corrected_px - reference
    band = np.digitize(reference, BANDS_PX)
    known = np.isfinite(error) & (band > 0) & (band < len(BANDS_PX))
    columns = (frame.u, frame.v, reference, error, *np.nan_to_num(frame.slope).T)
    u, v, reference, error, slope_u, slope_v = (column[known] for column in columns)
    cell = (v * ROWS / height).astype(np.int64) * COLUMNS + (u * COLUMNS / width).astype(np.int64)
    block = cell * len(BANDS_PX) + band[known]
    order = np.argsort(block, kind="stable")
    cuts = np.flatnonzero(np.diff(block[order])) + 1
    found = []
    for inside in np.split(order, cuts):
        if len(inside) < MIN_POINTS:
            continue
        median = float(np.median(error[inside]))
        deviation = robust_sigma(error[inside] - median)
        sigma = np.hypot(FLOOR_PX, MEDIAN_PER_MEAN * deviation / np.sqrt(len(inside) / ALIKE))
        place = [float(np.median(column[inside])) for column in (u, v, reference)]
        slopes = [float(np.median(column[inside])) for column in (slope_u, slope_v)]
        found.append((*place, median, float(sigma), *slopes, float(number)))
    return found
