"""What is told of a list of errors: the statistics that evo tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of errors, in their unit.

    Args:
        n: how many.
        rmse: root of the mean square.
        mean: arithmetic.
        median: half are below.
        max: the largest.
        min: the smallest.
        std: about the mean.
    """

    n: int
    rmse: float
    mean: float
    median: float
    max: float
    min: float
    std: float

    @classmethod
    def of(cls, errors: Float64) -> ErrorStatistics | None:
        """Of (N,) errors; None of none."""
        if not len(errors):
            return None
        return cls(
            n=len(errors),
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(errors.mean()),
            median=float(np.median(errors)),
            max=float(errors.max()),
            min=float(errors.min()),
            std=float(errors.std()),
        )

    def as_dict(self, unit: str) -> dict[str, float]:
        """`rmse_m` and so on."""
        names = ("rmse", "mean", "median", "max", "min", "std")
        return {f"{name}_{unit}": getattr(self, name) for name in names}


def statistics_dict(statistics: ErrorStatistics | None, unit: str) -> dict[str, float | None]:
    """`rmse_m` and so on; null where there is nothing."""
    if statistics is not None:
        return dict(statistics.as_dict(unit))
    return {f"{name}_{unit}": None for name in ("rmse", "mean", "median", "max", "min", "std")}
