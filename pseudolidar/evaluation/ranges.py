"""Relative depth errors by range of the reference, pooled over all pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pseudolidar.structures.arrays import Float64

# Bins of the reference's depth Z, m.
RANGE_BINS_M: Sequence[tuple[int, int]] = ((5, 10), (10, 20), (20, 30), (30, 50), (50, 80))


@dataclass(frozen=True)
class RangeErrors:
    """Depth errors relative to the reference of one bin; None where the bin is empty.

    Args:
        from_m: nearest depth of the bin, inclusive.
        to_m: farthest depth, exclusive.
        n: pixels or points.
        median_rel: median absolute relative error.
        p90_rel: 90th percentile of it.
        bias_rel: signed median; > 0 where the estimate is too far.
    """

    from_m: int
    to_m: int
    n: int
    median_rel: float | None
    p90_rel: float | None
    bias_rel: float | None

    def as_dict(self) -> dict[str, Any]:
        """The fields."""
        return asdict(self)


def errors_by_range(depth_m: Float64, reference_m: Float64) -> tuple[RangeErrors, ...]:
    """Relative depth errors in every bin of `RANGE_BINS_M`.

    Args:
        depth_m: (N,) estimated Z; pairs that are not finite are left out.
        reference_m: (N,) true Z, which decides about the bin.
    """
    both = np.isfinite(depth_m) & np.isfinite(reference_m)
    depth_m, reference_m = depth_m[both], reference_m[both]
    relative = depth_m / reference_m - 1.0
    return tuple(
        _bin(relative[(reference_m >= low) & (reference_m < high)], low, high)
        for low, high in RANGE_BINS_M
    )


def _bin(relative: Float64, low_m: int, high_m: int) -> RangeErrors:
    if not len(relative):
        return RangeErrors(low_m, high_m, 0, None, None, None)
    size = np.abs(relative)
    median, p90 = np.quantile(size, (0.5, 0.9))
    return RangeErrors(
        low_m, high_m, len(relative), float(median), float(p90), float(np.median(relative))
    )
