"""How a comparison of clouds with clouds went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.evaluation.comparison.clouds import F_RADII_M, CloudComparison, CloudFigures
from pseudolidar.running.reports.left_out import left_out_facts, left_out_words
from pseudolidar.running.reports.numbers import bare, bare_metres, counted
from pseudolidar.running.results import RunResult
from pseudolidar.running.table import ruled_text

# Narrow enough for 80 columns: units stand in the head alone.
HEADER = (
    "range m",
    "acc. m",
    "half",
    "comp. m",
    "half",
    "cham. m",
    *(f"F{radius:g}%" for radius in F_RADII_M),
    "points",
)
LEGEND = (
    "nearest neighbours in the common view, by each point's range: mean distance of",
    "our points to the reference (accuracy; half are nearer than), of its points to",
    "ours (completeness), the mean of both (chamfer); F-scores at 0.1, 0.2, 0.5 m",
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
        left_out = left_out_facts(self.result, self.without_reference)
        return {**self.comparison.as_dict(), "notes": list(self.notes), **left_out}

    def as_dict(self) -> dict[str, Any]:
        """The same, and what there is to open."""
        warnings = list(self.result.warnings)
        return {**self.facts, "warnings": warnings, "files": [str(path) for path in self.files]}

    def text(self) -> str:
        """The table."""
        compared = self.comparison
        frames = f"{counted(compared.frames, 'frame')} against {compared.reference}"
        left_out = left_out_words(self.result, self.without_reference)
        lines = [
            compared.subject,
            ", ".join([frames, *left_out]),
            *(f"  {note}" for note in self.notes),
            *cloud_lines(compared),
            "",
            self.result.text(),
        ]
        return "\n".join([*lines, *(f"  {path}" for path in self.files)])


def cloud_lines(compared: CloudComparison | None) -> list[str]:
    """A row for every bin, and one for all of them; nothing where no clouds were compared."""
    if compared is None:
        return []
    names = [f"{low}-{high}" for low, high in (*compared.bins, compared.bins.range_m)]
    figures = (*compared.by_range, compared.overall)
    rows = [_row(name, each) for name, each in zip(names, figures, strict=True)]
    return ["", ruled_text(rows, header=HEADER), *LEGEND]


def _row(name: str, each: CloudFigures) -> tuple[str, ...]:
    return (name, *cloud_cells(each), str(each.n))


def cloud_cells(each: CloudFigures) -> tuple[str, ...]:
    """Distances and F-scores of a bin, in the order that all tables have them."""
    lengths = ("accuracy_m", "accuracy_median_m", "completeness_m", "completeness_median_m")
    scores = (f"f_score_{radius:g}".replace(".", "_") for radius in F_RADII_M)
    return (
        *(bare_metres(each.figures[length]) for length in (*lengths, "chamfer_m")),
        *(bare(each.figures[score], digits=1) for score in scores),
    )
