"""`corridor.csv`: the nearest thing in the corridor of each frame, and how fast it comes nearer."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.approach import Approach, Nearing
from pseudolidar.obstacles.corridor import Ahead
from pseudolidar.obstacles.corridor_view import CorridorView, State
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

# Figures of a frame begin so, and one more.
PREFIX, SEEN = "ahead_", "corridor_seen"
HEADER = ("frame", "time_s", "state", "seen")
AHEAD = ("distance_m", "sigma_m", "points", "across_m", "up_m", "bound")
APPROACH = ("closing_m_s", "sigma_closing_m_s", "contact_s", "sigma_contact_s")


@dataclass(frozen=True)
class Watched:
    """The corridor of one frame.

    Args:
        frame: id.
        time_s: of the picture; None of one that never had a pair.
        view: what is seen of the corridor; None of a frame that was skipped.
        approach: how fast the nearest thing comes nearer, where it was seen before.
    """

    frame: str
    time_s: float | None
    view: CorridorView | None
    approach: Approach | None = None

    @property
    def ahead(self) -> Ahead | None:
        """The nearest thing; None where nothing is seen."""
        return None if self.view is None else self.view.ahead

    @property
    def state(self) -> State | Literal["skipped"]:
        """Whether something is in it, nothing, too little is seen, or the frame was skipped."""
        return "skipped" if self.view is None else self.view.state


def view_figures(view: CorridorView | None) -> dict[str, Any]:
    """Of a frame, for its journal; nothing where no corridor is watched."""
    if view is None:
        return {}
    ahead = {} if view.ahead is None else vars(view.ahead)
    return {SEEN: view.seen, **{f"{PREFIX}{name}": value for name, value in ahead.items()}}


def view_of(figures: Mapping[str, Any]) -> CorridorView | None:
    """What was seen of the corridor again; None where none was watched."""
    if SEEN not in figures:
        return None
    fields = {
        name.removeprefix(PREFIX): value
        for name, value in figures.items()
        if name.startswith(PREFIX)
    }
    return CorridorView(Ahead(**fields) if fields else None, figures[SEEN])


def watched(frames: Sequence[tuple[str, float | None, Mapping[str, Any]]]) -> tuple[Watched, ...]:
    """The corridor of each frame, in their order.

    Args:
        frames: id, time in s, and figures: none of a frame that was skipped.
    """
    done, nearing = list[Watched](), Nearing()
    for name, time_s, figures in frames:
        one = Watched(name, time_s, view_of(figures))
        if time_s is not None and one.view is not None:
            one = replace(one, approach=nearing(time_s, one.ahead))
        done.append(one)
    return tuple(done)


def encode_corridor(frames: Sequence[Watched]) -> bytes:
    """One line for each frame; empty cells where nothing is known."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow([*HEADER, *AHEAD, *APPROACH])
    for one in frames:
        seen = None if one.view is None else one.view.seen
        rows.writerow(
            [
                one.frame,
                "" if one.time_s is None else f"{one.time_s:.9g}",
                one.state,
                "" if seen is None else f"{seen:.4f}",
                *_cells(one.ahead, len(AHEAD)),
                *_cells(one.approach, len(APPROACH)),
            ]
        )
    return text.getvalue().encode()


def watched_in(source: FrameSequence[Frame], records: Iterable[FrameRecord]) -> tuple[Watched, ...]:
    """The corridor of frames of a source that are done with, in its order."""
    time_s = {
        name: time_ns / NS_PER_S
        for name, time_ns in zip(source.ids, source.timestamps_ns, strict=True)
    }
    return watched([(r.id, time_s.get(r.id), r.figures) for r in records])


def _cells(values: Ahead | Approach | None, count: int) -> list[str]:
    known = [""] * count if values is None else list(vars(values).values())
    return ["" if value is None or value == "" else f"{value:.6g}" for value in known]
