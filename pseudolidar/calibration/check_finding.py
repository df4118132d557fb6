"""What a check of a pair found: one thing, how bad, how sure, and what mends it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

# What a finding does: stop a run, be one warning line of it, or be told by `check` alone. "unknown"
# means that the pair does not tell.
Severity = Literal["stop", "warn", "note", "good", "unknown"]
# Worst first; what cannot be told says less than anything that can.
SEVERITIES: tuple[Severity, ...] = ("stop", "warn", "note", "good", "unknown")
# Nothing that a few hundred matches say is surer than this.
SUREST = 0.999


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Args:
        name: what was looked at, such as `rows`.
        severity: what it means.
        text: what was seen, in words and numbers.
        sure: probability that this is so, 0 to 1; None where there is nothing to be sure of.
        mend: flag or command that mends it.
        figures: what was measured, by name with unit.
    """

    name: str
    severity: Severity
    text: str
    sure: float | None = None
    mend: str = ""
    figures: Mapping[str, float | int | None] = field(default_factory=dict)

    @property
    def seen(self) -> str:
        """What was seen, and how sure that is."""
        return self.text if self.sure is None else f"{self.text} ({percent(self.sure)} sure)"

    @property
    def line(self) -> str:
        """One line: what was seen, how sure that is, and what to do."""
        return f"{self.name}: {self.seen}" + (f". {self.mend}" if self.mend else "")

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "name": self.name,
            "severity": self.severity,
            "text": self.text,
            "sure": None if self.sure is None else round(self.sure, 3),
            "mend": self.mend,
            **{name: _rounded(value) for name, value in self.figures.items()},
        }


def percent(share: float) -> str:
    """A probability for people, rounded down: 99.9 % is the most that is said."""
    return f"{math.floor(share * 1000 + 1e-9) / 10:g} %"


def sure_beyond(value: float, limit: float, sigma: float) -> float:
    """Probability that a normal quantity is on the side of `limit` on which it was measured."""
    z = abs(value - limit) / max(sigma, 1e-9)
    return min(SUREST, 0.5 * (1.0 + math.erf(z / math.sqrt(2.0))))


def _rounded(value: float | int | None) -> float | int | None:
    if value is None or isinstance(value, int):
        return value
    return round(value, 4) if math.isfinite(value) else None
