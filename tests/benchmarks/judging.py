"""Figures of a benchmark beside what is wanted of them: what does not hold ends it with 1."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn


@dataclass(frozen=True)
class Figure:
    """A figure that is judged.

    Args:
        row: of the benchmark's table, and what of it.
        value: measured; NaN where it could not be, which does not hold.
        wanted: the most that it may be.
        least: the bound is the least that it may be.
        form: how both are written.
    """

    row: str
    value: float
    wanted: float
    least: bool = False
    form: str = "{:.2%}"

    @property
    def holds(self) -> bool:
        """Whether it is as wanted."""
        return self.value >= self.wanted if self.least else self.value <= self.wanted

    def line(self) -> str:
        """As printed."""
        value, wanted = self.form.format(self.value), self.form.format(self.wanted)
        return f"{self.row}: {value}, {'at least' if self.least else 'at most'} {wanted} wanted"


def end(figures: Iterable[Figure]) -> NoReturn:
    """Name what does not hold, and exit: with 0 where all does, else with 1."""
    judged = list(figures)
    missed = [one for one in judged if not one.holds]
    for one in missed:
        print(f"NOT HELD  {one.line()}")
    print(f"{len(judged) - len(missed)} of {len(judged)} figures hold", flush=True)
    sys.exit(1 if missed else 0)
