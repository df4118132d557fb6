"""Intervals of pooled figures by resampling frames, without touching the points again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.structures.arrays import Float64, Int64

# Resamples and the share of them that an interval holds.
RESAMPLES, COVERED = 1000, 0.95
SEED = 20
# Values are ranked in so many cells of equally many values; fewer different values are ranked
# exactly. A cell is 0.05 % of the values: far less than a resample moves a quantile.
CELLS = 2048

Interval = tuple[float, float]


class FrameBootstrap:
    """Resamples of the frames: each draws as many frames as there are, with replacement.

    Points of one frame share its errors, so frames are drawn and not points. Consecutive frames
    share some of them, too: of a short drive the intervals are rather too narrow.

    Args:
        frames: how many there are.
        resamples: how often they are drawn.
        seed: of the random numbers.

    Source: Efron & Tibshirani, An Introduction to the Bootstrap, 1993, chapters 8 and 13
        (percentile intervals of clustered data).
    """

    def __init__(self, frames: int, *, resamples: int = RESAMPLES, seed: int = SEED) -> None:
        self.frames = frames
        random = np.random.default_rng(seed)
        share = np.full(frames, 1.0 / max(1, frames))
        # (resamples, frames) how often each frame is drawn; whole numbers, so sums of products
        # are exact and no library's order of summing shows.
        self.drawn = random.multinomial(frames, share, size=resamples).astype(np.float64)

    def sums(self, values: Float64, frame: Int64) -> Float64:
        """(resamples,) sum over the points drawn.

        Args:
            values: (N,) of the points.
            frame: (N,) number of each point's frame.
        """
        of_frame = np.bincount(frame, values, minlength=self.frames)
        return np.asarray((self.drawn * of_frame).sum(axis=1))

    def quantiles(self, values: Float64, frame: Int64, shares: Sequence[float]) -> Float64:
        """(len(shares), resamples) quantiles of the points drawn; NaN where none was.

        Args:
            values: (N,) of the points.
            frame: (N,) number of each point's frame.
            shares: 0.5 for the median.
        """
        if not len(values):
            return np.full((len(shares), len(self.drawn)), np.nan)
        levels, cell = _ranked(values)
        counts = np.bincount(frame * len(levels) + cell, minlength=self.frames * len(levels))
        counted = np.cumsum(self.drawn @ counts.reshape(self.frames, -1).astype(np.float64), axis=1)
        return np.stack([_quantile(levels, counted, share) for share in shares])


def interval(estimates: Float64) -> Interval | None:
    """The middle 95 % of estimates (resamples,); None where no resample has one."""
    known = estimates[np.isfinite(estimates)]
    if not len(known):
        return None
    low, high = np.quantile(known, ((1 - COVERED) / 2, (1 + COVERED) / 2))
    return float(low), float(high)


def _ranked(values: Float64) -> tuple[Float64, Int64]:
    """Levels, increasing, and for each value the number of its level."""
    order = np.argsort(values)
    ordered = values[order]
    rises = np.diff(ordered, prepend=ordered[:1]) > 0
    steps: Int64 = np.cumsum(rises, dtype=np.int64)  # 0 for the smallest
    if steps[-1] < CELLS:
        levels = ordered[np.flatnonzero(np.diff(steps, prepend=-1))]
    else:
        steps = np.arange(len(values)) * CELLS // len(values)
        levels = ordered[(np.arange(CELLS) * 2 + 1) * len(values) // (2 * CELLS)]
    cell = np.empty(len(values), np.int64)
    cell[order] = steps
    return levels, cell


def _quantile(levels: Float64, counted: Float64, share: float) -> Float64:
    """Quantiles of levels with cumulated counts (resamples, levels), as numpy interpolates."""
    total = counted[:, -1]
    place = share * np.maximum(total - 1, 0)
    low, high = (
        levels[np.minimum(_counted_up_to(counted, rank), len(levels) - 1)]
        for rank in (np.floor(place), np.ceil(place))
    )
    return np.where(total > 0, low + (place - np.floor(place)) * (high - low), np.nan)


def _counted_up_to(counted: Float64, rank: Float64) -> Int64:
    """(resamples,) how many of a row's counts, which never fall, are at most its rank: bisected."""
    rows = np.arange(len(counted))
    low, high = np.zeros(len(counted), np.int64), np.full(len(counted), counted.shape[1], np.int64)
    while (apart := low < high).any():
        middle = (low + high) // 2
        below = counted[rows, np.minimum(middle, counted.shape[1] - 1)] <= rank
        low = np.where(apart & below, middle + 1, low)
        high = np.where(apart & ~below, middle, high)
    return low
