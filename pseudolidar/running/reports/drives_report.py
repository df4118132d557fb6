"""How the comparison of many drives went: one table, a row a drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, PseudolidarError, printable
from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.pooled import PooledFigures
from pseudolidar.running.reports.comparison_report import ComparisonReport
from pseudolidar.running.reports.numbers import percent
from pseudolidar.running.table import table_text


@dataclass(frozen=True, eq=False)
class DrivesReport:
    """How it went.

    Args:
        reports: of the drives, by name.
        failed: why others have none.
        every: figures of the points of all drives.
        files: what there is to open.
    """

    reports: Mapping[str, ComparisonReport]
    failed: Mapping[str, PseudolidarError]
    every: PooledFigures
    files: Sequence[Path] = ()

    @property
    def comparisons(self) -> Mapping[str, Comparison]:
        """The figures of every drive."""
        return {name: report.comparison for name, report in self.reports.items()}

    @property
    def exit_code(self) -> int:
        """0 all done, 4 where drives or frames were left out."""
        bad = any(report.exit_code for report in self.reports.values())
        return SOME_SKIPPED if bad or self.failed else ALL_DONE

    @property
    def facts(self) -> dict[str, Any]:
        """Pooled figures as those of a single drive, then every drive's own."""
        return {
            **self.every.as_dict(),
            "drives": [{"drive": name, **each.facts} for name, each in self.reports.items()],
            "failed": [{"drive": name, **each.as_dict()} for name, each in self.failed.items()],
        }

    def as_dict(self) -> dict[str, Any]:
        """The same, and what there is to open."""
        return {**self.facts, "files": [str(path) for path in self.files]}

    @property
    def header(self) -> tuple[str, ...]:
        """Of the table of drives."""
        ranges = [f"{low}-{high} m" for low, high in self.every.bins]
        return ("drive", "frames", *ranges, "all", "bias", "density", "points")

    def rows(self) -> list[tuple[str, ...]]:
        """Every drive, then all of them, as cells of `header`."""
        rows = [_row(name, report.comparison) for name, report in self.reports.items()]
        return [*rows, _row("all", self.every)]

    def text(self) -> str:
        """The table, and what was left out."""
        lines = ["median depth error by range of the reference, pooled over points"]
        lines.append(table_text(self.rows(), header=self.header))
        for name, report in self.reports.items():
            skipped = len(report.result.skipped)
            lines += [f"  {name}: {skipped} frames skipped"] if skipped else []
        lines += [f"  {name}: {printable(str(each))}" for name, each in self.failed.items()]
        return "\n".join([*lines, *(f"  {path}" for path in self.files)])


def _row(name: str, compared: Comparison | PooledFigures) -> tuple[str, ...]:
    frames = compared.frames if isinstance(compared, PooledFigures) else len(compared.per_frame)
    return (
        name,
        str(frames),
        *(percent(each.figures.median_rel) for each in compared.by_range),
        percent(compared.overall.median_rel),
        percent(compared.overall.bias_rel, signed=True),
        percent(compared.overall.density, digits=1),
        str(compared.overall.n),
    )
