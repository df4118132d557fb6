"""How a search for obstacles went: for people, for programs, and what to open."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.running.results import RunResult


@dataclass(frozen=True)
class ObstaclesReport:
    """How the search went.

    Args:
        result: frames, figures and times.
        out: output folder.
        tables: files with all obstacles.
    """

    result: RunResult
    out: Path
    tables: tuple[Path, ...]

    @property
    def exit_code(self) -> int:
        """0 all done, 4 some frames skipped, 130 or 143 stopped."""
        return self.result.exit_code

    def as_dict(self) -> dict[str, Any]:
        """Counts, figures, times and where the results are."""
        where = {"out": str(self.out), "tables": [str(path) for path in self.tables]}
        return {**self.result.as_dict(), **where}

    def text(self) -> str:
        """The same for people, and what to open."""
        figures = self.result.figures
        lines = [self.result.text()]
        if "obstacles" in figures:
            count = figures["obstacles"]
            lines.append(f"  {count['mean']:.1f} obstacles a frame, at most {count['max']:.0f}")
        if "nearest_m" in figures:
            lines.append(f"  the nearest at {figures['nearest_m']['min']:.2f} m")
        tables = (path for path in self.tables if path.exists())
        return "\n".join([*lines, *(f"  {path}" for path in tables)])
