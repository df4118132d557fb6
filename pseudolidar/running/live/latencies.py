"""Latencies of a run of any length: a few hundred counters, however many frames there are."""

from __future__ import annotations

import math

import numpy as np

# Bins from 0.1 ms on, each 2 % wider than the one before; the last holds all beyond 5 min.
LEAST_S, RATIO, BINS = 1e-4, 1.02, 754


class Latencies:
    """Counts latencies by size; quantiles are exact to 1 %."""

    def __init__(self) -> None:
        self._counts = np.zeros(BINS, np.int64)

    def __len__(self) -> int:
        return int(self._counts.sum())

    def add(self, seconds: float) -> None:
        """One more."""
        above = math.log(max(seconds, LEAST_S) / LEAST_S, RATIO)
        self._counts[min(int(above), BINS - 1)] += 1

    def quantile_s(self, share: float) -> float | None:
        """The latency that this share of the frames does not exceed; None without a frame."""
        if not len(self):
            return None
        rank = max(1, math.ceil(share * len(self)))
        at = int(np.searchsorted(np.cumsum(self._counts), rank))
        return float(LEAST_S * RATIO ** (at + 0.5))
