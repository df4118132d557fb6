"""What the colour of a point means, and the bar that says so."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from pseudolidar.evaluation.comparison.error_cloud import dimmed, signed_colours
from pseudolidar.evaluation.pictures import turbo
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64, UInt8
from pseudolidar.structures.cloud import PointCloud

ColourBy = Literal[
    "photo", "height", "range", "sigma", "error", "intensity", "object", "time", "plain"
]
EVERY_WAY: tuple[ColourBy, ...] = get_args(ColourBy)
UNITS: dict[ColourBy, str] = {
    "height": "m",
    "range": "m",
    "sigma": "m",
    "error": "m",
    "intensity": "",
    "time": "s",
}
# Columns of clouds that hold what is shown.
COLUMNS: dict[ColourBy, tuple[str, ...]] = {
    "error": ("error_m", "error"),
    "object": ("object", "track", "label"),
    "time": ("time_s", "time", "t", "frame_index"),
}
PLAIN = (200, 205, 212)
# Shares of the points that lie below and above the ends of a scale that suits them.
LOW_SHARE, HIGH_SHARE = 0.02, 0.98
# Of errors, which have few ends far out: so many points lie within the ends of their scale.
ERROR_SHARE = 0.9
# Multiples of the golden ratio differ most from one another, whatever their number.
GOLDEN = 0.61803398875


@dataclass(frozen=True)
class Scale:
    """A bar of colours: from blue at `low` to red at `high`.

    Args:
        low: value that is blue.
        high: value that is red.
        unit: of both.
        signed: whether 0 is white, as of errors, and no colour of the rainbow is between.
    """

    low: float
    high: float
    unit: str = ""
    signed: bool = False

    @property
    def text(self) -> str:
        """Both ends in words."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:.3g} - {self.high:.3g}{unit}"

    def picture(self, width_px: int = 256, height_px: int = 14) -> UInt8:
        """(H, W, 3) RGB of the bar."""
        values = np.linspace(self.low, self.high, width_px, dtype=np.float32)
        rows = np.tile(values, (height_px, 1))
        if self.signed:
            return signed_colours(_shares(rows, self.low, self.high))
        return turbo(rows, self.low, self.high)


@dataclass(frozen=True)
class Colouring:
    """How points are coloured.

    Args:
        by: what their colour means.
        low: value that is blue; None for what suits the first cloud.
        high: value that is red; None likewise.
        colour: RGB of a cloud that is plain.
    """

    by: ColourBy = "photo"
    low: float | None = None
    high: float | None = None
    colour: tuple[int, int, int] = PLAIN

    def settled(self, cloud: PointCloud) -> Colouring:
        """The same with ends that suit a cloud, so that later ones have the same colours."""
        if self.low is not None and self.high is not None:  # seen before values are, which cost
            return self
        values = _values(cloud, self.by)
        if values is None:
            return self
        known = values[np.isfinite(values)]
        low, high = _ends(known, self.by)
        return replace(
            self,
            low=float(low) if self.low is None else self.low,
            high=float(max(high, low + 1e-3)) if self.high is None else self.high,
        )

    def scale(self) -> Scale | None:
        """The bar; None where colours are no numbers, or the ends are not settled."""
        if self.by not in UNITS or self.low is None or self.high is None:
            return None
        return Scale(self.low, self.high, UNITS[self.by], signed=self.by == "error")

    def colours(self, cloud: PointCloud) -> UInt8:
        """(N, 3) RGB of the points; grey where a cloud has no such column."""
        if self.by == "photo" and cloud.rgb is not None:
            return cloud.rgb
        if self.by == "object":
            return _of_objects(cloud)
        settled = self.settled(cloud)
        values = _values(cloud, self.by)
        if values is None and self.by == "error":  # not judged yet
            return dimmed(cloud)
        if values is None or settled.low is None or settled.high is None:
            return np.full((len(cloud), 3), self.colour, np.uint8)
        if self.by == "error":
            shown = signed_colours(_shares(values, settled.low, settled.high))
            return np.where(np.isfinite(values)[:, None], shown, dimmed(cloud))
        return turbo(values, settled.low, settled.high)

    def telling(self, cloud: PointCloud) -> Bool | None:
        """(N,) points that must be among the drawn ones: few have an error. None for any."""
        values = _values(cloud, self.by) if self.by == "error" else None
        return None if values is None else np.isfinite(values)


def ways(cloud: PointCloud, *, judged: bool = False) -> tuple[ColourBy, ...]:
    """What the colours of this cloud's points can mean.

    Args:
        cloud: as it is.
        judged: whether it gets a column of errors when it is asked for.
    """
    return tuple(by for by in EVERY_WAY if _possible(cloud, by) or (judged and by == "error"))


def _possible(cloud: PointCloud, by: ColourBy) -> bool:
    if by == "photo":
        return cloud.rgb is not None
    if by == "object":
        return _column(cloud, by) is not None
    return by == "plain" or _values(cloud, by) is not None


def _ends(known: Float32, by: ColourBy) -> tuple[float, float]:
    """What is blue and what is red of finite values."""
    if not len(known):
        return (-1.0, 1.0) if by == "error" else (0.0, 1.0)
    if by == "error":
        most = float(np.quantile(np.abs(known), ERROR_SHARE))
        return -max(most, 1e-3), max(most, 1e-3)
    low, high = np.quantile(known, (LOW_SHARE, HIGH_SHARE))
    return float(low), float(high)


def _shares(values: Float32, low: float, high: float) -> Float64:
    """Values as shares of what is red, or of what is blue, below 0; both have their own end."""
    ends = np.where(values > 0, max(high, 1e-6), max(-low, 1e-6))
    return np.asarray(values, np.float64) / ends


def _values(cloud: PointCloud, by: ColourBy) -> Float32 | None:
    """(N,) what is shown as a colour; None where the cloud does not know."""
    if by == "height":
        return np.asarray(cloud.xyz[:, 2], np.float32)
    if by == "range":
        x, y, z = cloud.xyz.T
        return np.asarray(np.sqrt(x * x + y * y + z * z), np.float32)
    if by == "sigma":
        return cloud.sigma_m
    if by == "intensity":
        return cloud.intensity
    column = _column(cloud, by)
    return None if column is None or by == "object" else np.asarray(column, np.float32)


def _column(cloud: PointCloud, by: ColourBy) -> AnyArray | None:
    names = COLUMNS.get(by, ())
    found = (cloud.extra[name] for name in names if name in cloud.extra)
    return next((column for column in found if column.ndim == 1), None)


def _of_objects(cloud: PointCloud) -> UInt8:
    numbers = _column(cloud, "object")
    return _plain(len(cloud)) if numbers is None else object_colours(numbers)


def object_colours(numbers: AnyArray) -> UInt8:
    """(N, 3) RGB by number of an object, (N,); grey for none: what is below 1, or NaN."""
    known = np.nan_to_num(np.asarray(numbers, np.float64), nan=-1.0)
    colours = turbo(np.asarray((known * GOLDEN) % 1.0, np.float32), -0.1, 1.1)
    colours[known < 1] = PLAIN
    return colours


def _plain(count: int) -> UInt8:
    return np.full((count, 3), PLAIN, np.uint8)
