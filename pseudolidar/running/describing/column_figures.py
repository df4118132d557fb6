"""Figures of the columns of clouds: least, largest, share without a value; of one or of many."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud


@dataclass(frozen=True)
class ColumnFigures:
    """What the values of a column are.

    Args:
        dtype: of the values.
        count: how many.
        nan: how many are NaN.
        least: smallest of the others; None where there are none.
        largest: largest of the others.
    """

    dtype: str
    count: int
    nan: int
    least: float | None
    largest: float | None

    @classmethod
    def of(cls, values: AnyArray) -> Self:
        """Figures of (N,) values."""
        known = values
        if values.dtype.kind == "f":
            known = values[~np.isnan(values)]
        ends = (known.min().item(), known.max().item()) if len(known) else (None, None)
        least, largest = (None if end is None else float(end) for end in ends)
        return cls(values.dtype.name, len(values), len(values) - len(known), least, largest)

    def joined(self, other: ColumnFigures) -> ColumnFigures:
        """Figures of both."""
        dtype = self.dtype if self.dtype == other.dtype else f"{self.dtype}, {other.dtype}"
        least = [end for end in (self.least, other.least) if end is not None]
        largest = [end for end in (self.largest, other.largest) if end is not None]
        return ColumnFigures(
            dtype,
            self.count + other.count,
            self.nan + other.nan,
            min(least, default=None),
            max(largest, default=None),
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        share = self.nan / self.count if self.count else None
        ends = {"min": self.least, "max": self.largest}
        return {"dtype": self.dtype, "count": self.count, **ends, "nan_share": share}


@dataclass(frozen=True)
class CloudFigures:
    """Figures of one or many clouds.

    Args:
        clouds: how many.
        least_points: of one.
        most_points: of one.
        columns: figures of each column.
        range_m: least and largest distance from the sensor; None without a point.
    """

    clouds: int
    least_points: int
    most_points: int
    columns: Mapping[str, ColumnFigures]
    range_m: tuple[float, float] | None

    @classmethod
    def of(cls, cloud: PointCloud) -> Self:
        """Figures of a cloud."""
        columns: dict[str, AnyArray] = {axis: cloud.xyz[:, i] for i, axis in enumerate("xyz")}
        if cloud.rgb is not None:
            columns |= {name: cloud.rgb[:, i] for i, name in enumerate(("red", "green", "blue"))}
        for name in ("intensity", "sigma_m"):
            column = getattr(cloud, name)
            if column is not None:
                columns[name] = column
        if cloud.uv is not None:
            columns |= {"u": cloud.uv[:, 0], "v": cloud.uv[:, 1]}
        columns |= {name: values for name, values in cloud.extra.items() if values.ndim == 1}
        distances = np.linalg.norm(cloud.xyz[cloud.valid], axis=1)
        ends = (float(distances.min()), float(distances.max())) if len(distances) else None
        figures = {name: ColumnFigures.of(values) for name, values in columns.items()}
        return cls(1, len(cloud), len(cloud), figures, ends)

    def joined(self, other: CloudFigures) -> CloudFigures:
        """Figures of both."""
        columns = dict(self.columns)
        for name, figures in other.columns.items():
            columns[name] = columns[name].joined(figures) if name in columns else figures
        ends = [ends for ends in (self.range_m, other.range_m) if ends is not None]
        return CloudFigures(
            self.clouds + other.clouds,
            min(self.least_points, other.least_points),
            max(self.most_points, other.most_points),
            columns,
            (min(e[0] for e in ends), max(e[1] for e in ends)) if ends else None,
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "clouds": self.clouds,
            "points": {"min": self.least_points, "max": self.most_points},
            "range_m": None if self.range_m is None else list(self.range_m),
            "bounding_box_m": {
                axis: [self.columns[axis].least, self.columns[axis].largest] for axis in "xyz"
            },
            "columns": [
                {"name": name, **figures.as_dict()} for name, figures in self.columns.items()
            ],
        }


def joined(figures: Iterable[CloudFigures]) -> CloudFigures | None:
    """Figures of all clouds, None of none."""
    total: CloudFigures | None = None
    for each in figures:
        total = each if total is None else total.joined(each)
    return total
