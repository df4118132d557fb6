"""How a comparison went: for people, for programs, and what to open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.figures import DepthFigures
from pseudolidar.running.reports.clouds_report import cloud_lines
from pseudolidar.running.reports.left_out import left_out_facts, left_out_words
from pseudolidar.running.reports.numbers import bare, counted, percent
from pseudolidar.running.results import RunResult
from pseudolidar.running.table import ruled_text
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

# Narrow enough for 80 columns: percent signs stand in the head alone.
HEADER = (
    "range m",
    "median%",
    "interval",
    "90 %",
    "bias%",
    "RMSE m",
    "dense%",
    "points",
    "in 1s%",
    "in 95%",
)
LEGEND = (
    "relative depth error: median, its 95 % interval over frames, 90th percentile,",
    "signed median (+ is too far); share of reference points that stereo has; share",
    "of errors within one sigma (68 is right) and within the 95 % radius",
)


@dataclass(frozen=True, eq=False)
class ComparisonReport:
    """How the comparison went.

    Args:
        comparison: its figures.
        result: frames and times.
        without_reference: frames that have nothing to be compared with.
        notes: what people should know about it.
        files: what there is to open.
    """

    comparison: Comparison
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
        """Figures, then what was left out; the same however the run went."""
        left_out = left_out_facts(self.result, self.without_reference)
        return {**self.comparison.as_dict(), **left_out, "notes": list(self.notes)}

    def as_dict(self) -> dict[str, Any]:
        """The same, and what there is to open."""
        warnings = list(self.result.warnings)
        return {**self.facts, "warnings": warnings, "files": [str(path) for path in self.files]}

    def without_points(self) -> ComparisonReport:
        """The same figures, without what they were made of."""
        return replace(self, comparison=replace(self.comparison, frames=()))

    def text(self) -> str:
        """Tables for a terminal, the causes in words, and what to open."""
        compared = self.comparison
        frames = f"{counted(len(compared.per_frame), 'frame')} against {compared.reference}"
        left_out = left_out_words(self.result, self.without_reference)
        lines = [
            compared.subject,
            f"{', '.join([frames, *left_out])}; pooled over points, by the reference's depth",
            *(f"  {note}" for note in self.notes),
            "",
            comparison_table(compared),
            *LEGEND,
            "",
            *overall_lines(compared),
            *cloud_lines(compared.clouds),
            *diagnosis_lines(compared),
            self.result.text(),
        ]
        return "\n".join([*lines, *(f"  {path}" for path in self.files)])


def comparison_table(compared: Comparison) -> str:
    """A row for every bin, and one for all of them."""
    rows = [row_of(f"{each.from_m}-{each.to_m}", each.figures) for each in compared.by_range]
    first, last = compared.bins.range_m
    return ruled_text([*rows, row_of(f"{first}-{last}", compared.overall)], header=HEADER)


def row_of(name: str, figures: DepthFigures) -> tuple[str, ...]:
    """Figures as cells of `HEADER`."""
    bounds = figures.intervals.get("median_rel")
    return (
        name,
        bare(figures.median_rel),
        "" if bounds is None else f"{100 * bounds[0]:.2f}-{100 * bounds[1]:.2f}",
        bare(figures.p90_rel),
        bare(figures.bias_rel, signed=True),
        "-" if figures.rmse_m is None else f"{figures.rmse_m:.2f}",
        bare(figures.density, digits=1),
        str(figures.n),
        bare(figures.within_1_sigma, digits=1),
        bare(figures.within_95, digits=1),
    )


def overall_lines(compared: Comparison) -> list[str]:
    """Overall figures that the table has no column for."""
    overall = compared.overall
    if not overall.n:
        return []
    lines = [
        f"all: abs rel {percent(overall.abs_rel)}, RMSE {overall.rmse_m:.2f} m, "
        f"RMSE log {overall.rmse_log:.3f}, off by less than 1.05 "
        f"{percent(overall.delta_1_05, digits=1)}, than 1.25 "
        f"{percent(overall.delta_1_25, digits=1)}"
    ]
    if overall.within_1_sigma is not None:
        ause = compared.sparsification and f"{compared.sparsification.area:.2f}"
        lines.append(
            f"sigma: {percent(overall.within_1_sigma, digits=1)} of the errors within one sigma "
            f"({ONE_SIGMA_SHARE:.0%} are right), {percent(overall.within_95, digits=1)} within the "
            f"95 % radius; AUSE {ause or '-'}"
        )
    return lines


def diagnosis_lines(compared: Comparison) -> list[str]:
    """What is wrong with the rig, in words."""
    lines = ["diagnosis: too few points for one"]
    if compared.diagnosis is not None:
        lines = ["diagnosis:", *(f"  {line}" for line in compared.diagnosis.text().splitlines())]
    return lines if compared.timing is None else [*lines, f"  {compared.timing.text}"]


def rig_note(rig: StereoRig) -> str:
    """Whether the rig was corrected, and its systematic error inside sigma."""
    if rig.correction is None:
        return f"rig as it came; systematic error in sigma {rig.systematic_sigma_px:g} px"
    corrected = f"rig corrected ({rig.correction.origin or 'origin unknown'})"
    return f"{corrected}; systematic error in sigma {rig.systematic_sigma_px:.2f} px"
