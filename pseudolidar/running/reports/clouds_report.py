"""How a comparison of clouds with clouds went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.evaluation.comparison.clouds import F_RADII_M, CloudComparison, CloudFigures
from pseudolidar.running.reports.comparison_report import percent
from pseudolidar.running.results import RunResult
from pseudolidar.running.table import table_text

HEADER = (
    "range",
    "accuracy",
    "(median)",
    "completeness",
    "(median)",
    "chamfer",
    *(f"F {radius:g} m" for radius in F_RADII_M),
    "points",
    "reference",
)


@dataclass(frozen=True, eq=False)
class CloudsReport:
    """How it went.

    Args:
        comparison: its figures.
        result: frames and times.
        without_reference: frames that have nothing to be compared with.
        notes: what people should know about the source.
        files: what there is to open.
    """

    comparison: CloudComparison
    result: RunResult
    without_reference: int = 0
    notes: Sequence[str] = ()
    files: Sequence[Path] = ()

    @property
    def exit_code(self) -> int:
        """0 all done, 4 some frames skipped."""
        return self.result.exit_code

    @property
    def facts(self) -> dict[str, Any]:
        """Figures, then what was left out."""
        skipped = [{"id": each.id, **(each.skipped or {})} for each in self.result.skipped]
        left_out = {"without_reference": self.without_reference, "skipped": skipped}
        return {**self.comparison.as_dict(), "notes": list(self.notes), **left_out}

    def as_dict(self) -> dict[str, Any]:
        """The same, and what there is to open."""
        return {**self.facts, "files": [str(path) for path in self.files]}

    def text(self) -> str:
        """The table."""
        compared = self.comparison
        left_out = f", {self.without_reference} without reference" if self.without_reference else ""
        lines = [
            compared.subject,
            f"{compared.frames} frames against {compared.reference}{left_out}; nearest neighbours "
            "in the common view, by each point's range",
            *(f"  {note}" for note in self.notes),
            table_text(rows_of(compared), header=HEADER),
            self.result.text(),
        ]
        return "\n".join([*lines, *(f"  {path}" for path in self.files)])


def rows_of(compared: CloudComparison) -> list[tuple[str, ...]]:
    """Every bin, then all of them, as cells of `HEADER`."""
    names = [f"{low}-{high} m" for low, high in (*compared.bins, compared.bins.range_m)]
    figures = (*compared.by_range, compared.overall)
    return [_row(name, each) for name, each in zip(names, figures, strict=True)]


def _row(name: str, each: CloudFigures) -> tuple[str, ...]:
    def metres(figure: str) -> str:
        value = each.figures[figure]
        return "-" if value is None else f"{value:.3f} m"

    scores = (f"f_score_{radius:g}".replace(".", "_") for radius in F_RADII_M)
    return (
        name,
        metres("accuracy_m"),
        metres("accuracy_median_m"),
        metres("completeness_m"),
        metres("completeness_median_m"),
        metres("chamfer_m"),
        *(percent(each.figures[score], digits=1) for score in scores),
        str(each.n),
        str(each.reference),
    )
