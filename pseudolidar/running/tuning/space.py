"""What can be varied: one dimension of the unit cube for each setting."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from pseudolidar.errors import UsageError
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.sgbm import Bm, Sgbm

Tunable = Census | Sgbm | Bm


@dataclass(frozen=True)
class Candidate:
    """Settings that can be tried.

    Args:
        matcher: how disparities are found.
        smooth: how they are smoothed.
        fill: how holes are filled.
    """

    matcher: Tunable
    smooth: Fgs | None = None
    fill: Surfaces | None = None


class Dimension(Protocol):
    """One setting, or one choice."""

    @property
    def name(self) -> str:
        """Of the setting, `part.field`."""

    def value(self, unit: float) -> Any:
        """The setting's value at a place from 0 to 1."""

    def unit(self, value: Any) -> float:
        """Where a value is, 0 to 1."""


@dataclass(frozen=True)
class Number:
    """A number in a range.

    Args:
        name: of the setting.
        low: smallest value.
        high: largest.
        log: whether ratios count, not differences.
        step: values are multiples of it; 1 for whole numbers.
    """

    name: str
    low: float
    high: float
    log: bool = False
    step: float = 1

    def value(self, unit: float) -> int | float:
        """The value, a whole number where the step is one."""
        low, high = self._ends
        place = low + unit * (high - low)
        steps = round((math.exp(place) if self.log else place) / self.step)
        value = min(max(steps * self.step, self.low), self.high)
        return round(value) if self.step == int(self.step) else round(value, 6)

    def unit(self, value: float) -> float:
        """Where it is; values outside the range are at its end."""
        low, high = self._ends
        inside = min(max(value, self.low), self.high)
        return ((math.log(inside) if self.log else inside) - low) / (high - low)

    @property
    def _ends(self) -> tuple[float, float]:
        return (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)


@dataclass(frozen=True)
class Choice:
    """One of some values.

    Args:
        name: of the setting.
        values: neighbours are alike, where that can be said.
    """

    name: str
    values: tuple[Any, ...]

    def value(self, unit: float) -> Any:
        """The value."""
        return self.values[min(int(unit * len(self.values)), len(self.values) - 1)]

    def unit(self, value: Any) -> float:
        """The middle of the value's share."""
        nearest = self.values.index(value) if value in self.values else 0
        return (nearest + 0.5) / len(self.values)


# Ranges reach well beyond what was good on any data; where the best lies at an end, widen it.
_SPECKLES = Number("matcher.speckle_pixels", 20, 1000, log=True)
_MATCHERS: dict[type, tuple[Dimension, ...]] = {
    Census: (
        Choice("matcher.quality", ("fast", "fine")),
        Number("matcher.penalty_small", 3, 24, log=True),
        Number("matcher.penalty_large", 36, 95),
        Number("matcher.uniqueness_percent", 0, 25, step=0.5),
        Number("matcher.agreement_px", 0.4, 3, log=True, step=0.05),
        _SPECKLES,
        Number("matcher.speckle_step_px", 0.5, 3, log=True, step=0.05),
    ),
    Sgbm: (
        Choice("matcher.mode", ("3way", "hh4", "sgbm", "hh")),
        Choice("matcher.block_size", (1, 3, 5, 7, 9, 11)),
        Number("matcher.p1", 1, 24, log=True, step=0.25),  # a pixel of the block
        Number("matcher.p2", 1.5, 16, log=True, step=0.25),  # times p1
        Number("matcher.uniqueness_percent", 0, 25),
        Number("matcher.pre_filter_cap", 7, 127, log=True),
        _SPECKLES,
        Number("matcher.speckle_step_px", 1, 4),
        Number("matcher.agreement_px", 1, 3),
        Choice("matcher.right_matcher", (False, True)),
    ),
    Bm: (
        Choice("matcher.block_size", tuple(range(5, 33, 2))),
        Number("matcher.texture", 1, 200, log=True),
        Number("matcher.uniqueness_percent", 0, 30),
        Number("matcher.pre_filter_cap", 5, 63, log=True),
        _SPECKLES,
        Number("matcher.speckle_step_px", 1, 4),
        Number("matcher.agreement_px", 1, 3),
        Choice("matcher.right_matcher", (False, True)),
    ),
}
_SMOOTH: tuple[Dimension, ...] = (
    Choice("smooth", (False, True)),
    Number("smooth.strength", 300, 60_000, log=True, step=100),
    Number("smooth.sigma_color", 0.5, 8, log=True, step=0.1),
)
# Of these the space holds shares of one another, not the settings' own values.
_AS_RATIOS = ("p1", "p2")
_FILL: tuple[Dimension, ...] = (
    Number("fill.largest_px", 4, 300, log=True),
    Number("fill.largest_m", 0.1, 10, log=True, step=0.1),
)


def numbers_of(kind: type) -> dict[str, Number]:
    """Ranges in which the numbers of a matcher or a filter are tried, by field.

    Those of SGBM's penalties are left out: they are tried as ratios.

    Args:
        kind: class of the settings.
    """
    filters: dict[type, tuple[Dimension, ...]] = {Fgs: _SMOOTH, Surfaces: _FILL}
    found = (d for d in (_MATCHERS | filters).get(kind, ()) if isinstance(d, Number))
    numbers = {number.name.partition(".")[2]: number for number in found}
    return {name: number for name, number in numbers.items() if name not in _AS_RATIOS}


@dataclass(frozen=True)
class Space:
    """All that is varied, around the settings that the search starts from.

    Args:
        start: the first settings that are tried.
        dimensions: of the unit cube.
    """

    start: Candidate
    dimensions: tuple[Dimension, ...]

    @classmethod
    def around(cls, start: Candidate, *, keep: Sequence[str] = ()) -> Space:
        """The matcher's settings, smoothing or not, and filling where that is chosen.

        Args:
            start: the first settings.
            keep: names of settings (`matcher.quality`, or `smooth` for all of a part) that stay.

        Raises:
            UsageError: one of them is none that is tuned, or none is left.
        """
        every = (*_MATCHERS[type(start.matcher)], *_SMOOTH, *(_FILL if start.fill else ()))
        known = {d.name: None for d in every} | {d.name.split(".")[0]: None for d in every}
        for name in keep:
            if name not in known:
                raise UsageError(
                    f"--keep {name}", want=f"settings that are tuned: {', '.join(known)}"
                )
        varied = [d for d in every if d.name not in keep and d.name.split(".")[0] not in keep]
        if not varied:
            raise UsageError("every setting is kept", want="some that may be tuned", where="--keep")
        return cls(start, tuple(varied))

    @property
    def names(self) -> tuple[str, ...]:
        """What is varied."""
        return tuple(dimension.name for dimension in self.dimensions)

    @property
    def origin(self) -> tuple[float, ...]:
        """Where the start is in the unit cube."""
        return self.place(self.start)

    def place(self, candidate: Candidate) -> tuple[float, ...]:
        """Where settings are in the unit cube."""
        at = _values_of(candidate)
        return tuple(dimension.unit(at[dimension.name]) for dimension in self.dimensions)

    def candidate(self, place: Sequence[float]) -> Candidate:
        """The settings at a place in the unit cube."""
        values = _values_of(self.start)
        chosen = zip(self.dimensions, place, strict=True)
        values |= {dimension.name: dimension.value(unit) for dimension, unit in chosen}
        return _with_values(self.start, values)


def _values_of(candidate: Candidate) -> dict[str, Any]:
    """Resolved values of everything that can be varied, by name."""
    matcher, smooth = candidate.matcher, candidate.smooth or Fgs()
    values: dict[str, Any] = {f"matcher.{name}": v for name, v in vars(matcher).items()}
    if isinstance(matcher, Census):
        values["matcher.penalty_small"] = matcher.small
        values["matcher.agreement_px"] = matcher.agreement
    if isinstance(matcher, Sgbm):
        p1, p2 = matcher.penalties
        values |= {"matcher.p1": p1 / matcher.block_size**2, "matcher.p2": p2 / p1}
    values |= {f"smooth.{name}": value for name, value in vars(smooth).items()}
    values["smooth"] = candidate.smooth is not None
    if candidate.fill is not None:
        values |= {f"fill.{name}": value for name, value in vars(candidate.fill).items()}
    return values


def _with_values(start: Candidate, values: Mapping[str, Any]) -> Candidate:
    """The settings with these values; penalties as OpenCV takes them."""
    of: dict[str, dict[str, Any]] = {"matcher": {}, "smooth": {}, "fill": {}}
    for name, value in values.items():
        part, dot, setting = name.partition(".")
        if dot:
            of[part][setting] = value
    matcher = of["matcher"]
    if isinstance(start.matcher, Sgbm):
        p1 = max(1, round(matcher["p1"] * matcher["block_size"] ** 2))
        matcher |= {"p1": p1, "p2": max(p1 + 1, round(matcher["p2"] * p1))}
    if isinstance(start.matcher, Census):
        matcher["penalty_small"] = min(matcher["penalty_small"], matcher["penalty_large"] - 1)
    return Candidate(
        replace(start.matcher, **matcher),
        replace(start.smooth or Fgs(), **of["smooth"]) if values["smooth"] else None,
        start.fill and replace(start.fill, **of["fill"]),
    )
