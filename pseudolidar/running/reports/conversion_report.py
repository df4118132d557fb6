"""How a conversion went: for people, for programs, and what to open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.clouds.correct import ANCHORED, GUIDED_SHARE, MOVED_PX
from pseudolidar.running.products.outputs import Outputs, folder_of
from pseudolidar.running.products.preview import PREVIEW_NAME
from pseudolidar.running.reports.removed import removed_lines
from pseudolidar.running.results import RunResult


@dataclass(frozen=True)
class ConvertReport:
    """How the conversion went.

    Args:
        result: frames, figures and times.
        out: output folder.
        to: what was written.
        page: `report.html`.
    """

    result: RunResult
    out: Path
    to: Outputs
    page: Path

    @property
    def exit_code(self) -> int:
        """0 all done, 4 some frames skipped, 130 or 143 stopped."""
        return self.result.exit_code

    def as_dict(self) -> dict[str, Any]:
        """Counts, figures, times and where the results are."""
        where = {"out": str(self.out), "page": str(self.page)}
        return {**self.result.as_dict(), **where, "to": list(self.to.kinds)}

    def text(self) -> str:
        """The same for people, and what to open."""
        figures = self.result.figures
        lines = [self.result.text()]
        if figures:
            matched = ""
            if "density" in figures:
                matched = f", {figures['density']['mean']:.1%} of the pixels matched"
            lines.append(f"  {figures['points']['mean']:.0f} points a frame{matched}")
            lines += [f"  {line}" for line in (*removed_lines(figures), *guided_lines(figures))]
        opens = [self.out / folder_of(kind) for kind in (*self.to.files, *self.to.trees)]
        opens += sorted(self.out.glob("*.mcap")) if self.to.recording else []
        opens += [path for path in (self.out / PREVIEW_NAME, self.page) if path.exists()]
        return "\n".join([*lines, *(f"  {path}" for path in opens)])


def guided_lines(figures: Mapping[str, Mapping[str, float]]) -> list[str]:
    """How far the clouds were guided by scans, or nothing where they were not.

    Args:
        figures: mean, least and largest value of each figure of the frames.
    """
    if ANCHORED not in figures:
        return []
    anchors, least = figures[ANCHORED]["mean"], figures[ANCHORED]["min"]
    share, moved_px = figures[GUIDED_SHARE]["mean"], figures[MOVED_PX]["mean"]
    return [
        f"guided by {anchors:.0f} LiDAR points a frame (at least {least:.0f}): {share:.0%} of the "
        f"surfaces by beams that meet them, disparities changed by {moved_px:.2f} px (median)"
    ]
