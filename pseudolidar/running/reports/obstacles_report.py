"""How a search for obstacles went: for people, for programs, and what to open."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pseudolidar.evaluation.obstacles import JudgedObject, by_band, usual_by_band
from pseudolidar.obstacles.corridor import StopRule
from pseudolidar.obstacles.corridor_view import State
from pseudolidar.running.networks import times_in_words
from pseudolidar.running.products.corridor_table import Watched
from pseudolidar.running.reports.numbers import counted
from pseudolidar.running.reports.obstacle_objects import objects_text
from pseudolidar.running.results import RunResult

# Exit code where something in the corridor is nearer than --stop-at: a robot must stop.
TOO_NEAR = 10
# So many labelled objects or fewer are printed without being asked for.
FEW_OBJECTS = 20
# What a corridor can be, and the words for it.
STATES: dict[State | Literal["skipped"], str] = {
    "thing": "something in it",
    "free": "free",
    "unseen": "unseen (too little of it has a depth)",
    "skipped": "skipped",
}


@dataclass(frozen=True)
class ObstaclesReport:
    """How the search went.

    Args:
        result: frames, figures and times.
        out: output folder.
        tables: files with all obstacles.
        corridor: the nearest thing of each frame; None where no corridor was watched.
        stop: what may not be in the corridor.
        objects: each label that counts beside what was measured of it, where there are labels.
        show_objects: print them, however many they are.
    """

    result: RunResult
    out: Path
    tables: tuple[Path, ...]
    corridor: tuple[Watched, ...] | None = None
    stop: StopRule | None = None
    objects: tuple[JudgedObject, ...] = ()
    show_objects: bool = False

    @property
    def too_near(self) -> Watched | None:
        """The first frame in which something in the corridor may be too near."""
        if self.stop is None:
            return None
        return next((one for one in self.corridor or () if self.stop.broken_by(one.ahead)), None)

    @property
    def nearest(self) -> Watched | None:
        """The frame with the nearest thing in the corridor."""
        seen = [(one.ahead.distance_m, one) for one in self.corridor or () if one.ahead is not None]
        return min(seen, key=lambda pair: pair[0])[1] if seen else None

    @property
    def exit_code(self) -> int:
        """10 something is too near; else 0 all done, 4 some frames skipped, 130 or 143 stopped."""
        return self.result.exit_code if self.too_near is None else TOO_NEAR

    def as_dict(self) -> dict[str, Any]:
        """Counts, figures, times and where the results are."""
        where = {"out": str(self.out), "tables": [str(path) for path in self.tables]}
        corridor = {} if self.corridor is None else {"corridor": self._corridor()}
        labelled = {"labelled": self._labelled()} if self.objects else {}
        told = {**self.result.as_dict(), **where, **corridor, **labelled}
        return {**told, "exit_code": self.exit_code}

    def _labelled(self) -> dict[str, Any]:
        """Errors by range, and each object."""
        return {
            "bands": [band.as_dict() for band in by_band(self.objects)],
            "usual_script": [band.as_dict() for band in usual_by_band(self.objects)],
            "objects": [dict(vars(one)) for one in self.objects],
        }

    def _corridor(self) -> dict[str, Any]:
        limit_m = None if self.stop is None else self.stop.limit_m
        states = Counter(one.state for one in self.corridor or ())
        told: dict[str, Any] = {
            "stop_at_m": limit_m,
            "stop_chance": self.stop and self.stop.chance,
            "frames": {state: states[state] for state in STATES},
        }
        for name, one in (("nearest", self.nearest), ("too_near", self.too_near)):
            told[name] = one and {
                "frame": one.frame,
                "time_s": one.time_s,
                **vars(one.ahead),
                "approach": one.approach and dict(vars(one.approach)),
                "sure": limit_m and one.ahead and one.ahead.nearer_than(limit_m),
            }
        return told

    def text(self) -> str:
        """The same for people, and what to open."""
        figures = self.result.figures
        lines = [self.result.text()]
        if "obstacles" in figures:
            count = figures["obstacles"]
            lines.append(f"  {count['mean']:.1f} obstacles a frame, at most {count['max']:.0f}")
        if "nearest_m" in figures:
            lines.append(f"  the nearest at {figures['nearest_m']['min']:.2f} m")
        networks = self.result.figures_of_run.get("networks", {})
        lines += [f"  {line}" for line in times_in_words(networks)]
        lines += [*self._corridor_lines(), *self._object_lines()]
        tables = (path for path in self.tables if path.exists())
        return "\n".join([*lines, *(f"  {path}" for path in tables)])

    def _object_lines(self) -> list[str]:
        """The labels beside what was measured: a table where it is short or asked for."""
        if not self.objects:
            return []
        measured = sum(one.measured_m is not None for one in self.objects)
        line = f"  {measured} of {counted(len(self.objects), 'labelled object')} measured"
        if self.show_objects or len(self.objects) <= FEW_OBJECTS:
            return [line, objects_text(self.objects)]
        return [f"{line}; --objects prints each"]

    def _corridor_lines(self) -> list[str]:
        if self.corridor is None:
            return []
        lines = [f"  corridor: {states_text(self.corridor)}"]
        if self.nearest is not None:
            lines.append(f"  nearest in the corridor: {_told(self.nearest)}")
        one = self.too_near
        if one is not None and one.ahead is not None and self.stop is not None:
            sure = one.ahead.nearer_than(self.stop.limit_m)
            lines.append(
                f"  STOP: nearer than {self.stop.limit_m:g} m ({sure:.0%} sure): {_told(one)}"
            )
        return lines


def states_text(corridor: Sequence[Watched]) -> str:
    """In how many frames something is in it, nothing, or nobody can tell."""
    counts = Counter(one.state for one in corridor)
    said = [f"{words} in {counts[state]}" for state, words in STATES.items() if counts[state]]
    return f"{', '.join(said) or 'not watched in any'} of {counted(len(corridor), 'frame')}"


def _told(one: Watched) -> str:
    assert one.ahead is not None  # those that are told have something ahead
    line = f"{one.ahead.distance_m:.2f} +- {one.ahead.sigma_m:.2f} m, frame {one.frame}"
    if one.ahead.bound:
        line += " (or nearer: the search ends there, see --min-depth)"
    if one.approach is None:
        return line
    line += f", closing at {one.approach.closing_m_s:.1f} +- {one.approach.sigma_m_s:.1f} m/s"
    if one.approach.contact_s is None:
        return line
    sigma_s = one.approach.sigma_contact_s or 0.0
    return f"{line}, reached in {one.approach.contact_s:.1f} +- {sigma_s:.1f} s"
