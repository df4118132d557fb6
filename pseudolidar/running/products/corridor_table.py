"""`corridor.csv`: the nearest thing in the corridor of each frame, and how fast it comes nearer."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.corridor import Ahead, Approach, approach
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

# Figures of a frame begin so.
PREFIX = "ahead_"
HEADER = ("frame", "time_s", "distance_m", "sigma_m", "points", "across_m", "up_m")
APPROACH = ("closing_m_s", "sigma_closing_m_s", "contact_s", "sigma_contact_s")


@dataclass(frozen=True)
class Watched:
    """The corridor of one frame.

    Args:
        frame: id.
        time_s: of the picture.
        ahead: the nearest thing, None where nothing is seen.
        approach: how fast it comes nearer, where it was seen before.
    """

    frame: str
    time_s: float
    ahead: Ahead | None
    approach: Approach | None


def ahead_figures(ahead: Ahead | None) -> dict[str, Any]:
    """Of a frame, for its journal; nothing where nothing is seen."""
    return (
        {} if ahead is None else {f"{PREFIX}{name}": value for name, value in vars(ahead).items()}
    )


def ahead_of(figures: Mapping[str, Any]) -> Ahead | None:
    """The nearest thing again."""
    fields = {
        name.removeprefix(PREFIX): value
        for name, value in figures.items()
        if name.startswith(PREFIX)
    }
    return Ahead(**fields) if fields else None


def watched(frames: Sequence[tuple[str, float, Mapping[str, Any]]]) -> tuple[Watched, ...]:
    """The corridor of each frame, in their order.

    Args:
        frames: id, time in s, and figures.
    """
    times = [time_s for _, time_s, _ in frames]
    seen = [ahead_of(figures) for _, _, figures in frames]
    return tuple(
        Watched(name, time_s, seen[i], approach(times[: i + 1], seen[: i + 1]))
        for i, (name, time_s, _) in enumerate(frames)
    )


def encode_corridor(frames: Sequence[Watched]) -> bytes:
    """One line for each frame; empty cells where nothing is seen."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow([*HEADER, *APPROACH])
    for one in frames:
        rows.writerow(
            [one.frame, f"{one.time_s:.9g}", *_cells(one.ahead, 5), *_cells(one.approach, 4)]
        )
    return text.getvalue().encode()


def write_corridor(
    path: Path, records: Iterable[FrameRecord], source: FrameSequence[Frame]
) -> tuple[Watched, ...]:
    """The corridor of all frames that are committed, in the order of the source, as a table."""
    time_s = {
        name: time_ns / NS_PER_S
        for name, time_ns in zip(source.ids, source.timestamps_ns, strict=True)
    }
    frames = watched([(r.id, time_s[r.id], r.figures) for r in records if r.skipped is None])
    write_atomic(path, encode_corridor(frames))
    return frames


def _cells(values: Ahead | Approach | None, count: int) -> list[str]:
    known = [""] * count if values is None else list(vars(values).values())
    return ["" if value is None or value == "" else f"{value:.6g}" for value in known]
