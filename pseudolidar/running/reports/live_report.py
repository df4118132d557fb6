"""How a live run went: for people, for programs, and what to open."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.running.live.meter import LiveFigures
from pseudolidar.running.live.table import rows
from pseudolidar.running.results import NAMED_SKIPS, RunResult
from pseudolidar.running.table import table_text


@dataclass(frozen=True)
class LiveReport:
    """How a live run went.

    Args:
        result: frames, figures and times.
        live: rates, latencies, losses.
        out: output folder.
        opens: what to open.
        views: what was seen of a board, "" where none was looked for.
    """

    result: RunResult
    live: LiveFigures
    out: Path
    opens: tuple[Path, ...]
    views: str = ""

    @property
    def exit_code(self) -> int:
        """0 ended as asked for, 4 some frames skipped, 130 or 143 stopped by a signal."""
        return self.result.exit_code

    def as_dict(self) -> dict[str, Any]:
        """Counts, figures, times, and where the results are."""
        return {**self.result.as_dict(), "out": str(self.out)}

    def text(self) -> str:
        """The same for people."""
        result = self.result
        before = len(result.committed) - result.passed_now
        kept = f", {before} of them from before" if before else ""
        lines = [f"{len(result.committed)} frames{kept}"]
        figures = result.figures
        if "density" in figures:
            lines.append(
                f"  {figures['points']['mean']:.0f} points a frame, "
                f"{figures['density']['mean']:.1%} of the pixels matched"
            )
        lines.append(table_text(rows(self.live)))
        lines += [self.views] if self.views else []
        lines += result.skip_lines(NAMED_SKIPS)
        if result.ended_by:
            lines.append("stopped; all that was written is whole, the same command adds to it")
        return "\n".join([*lines, *(f"  {path}" for path in self.opens)])
