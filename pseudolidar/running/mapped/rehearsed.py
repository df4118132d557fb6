"""A few neighbouring frames mapped in a folder of their own, to tell what all of them will take."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, Self

from pseudolidar.errors import OdometryLost
from pseudolidar.formats.atomic import free_bytes
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.folder import inside
from pseudolidar.running.mapped.stored import WORK_FOLDER, MatchedFrame, MatchOnce
from pseudolidar.running.mapped.walk import Walk
from pseudolidar.running.mapped.walked import Piece
from pseudolidar.running.rehearsal import MEGABYTE, Rehearsal
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSource

# Frames tried, beside each other, for odometry needs neighbours and a map three that agree. What
# the last so many of them add is what each further one is taken to add.
TRIED, LAST = 6, 2
# The first frames load kernels: their times are of no other.
WARMING = 2
NONE_PASSED = "matching and odometry: no frame that was tried could be matched"
NOT_PLACED = "the map: no frame that was tried could be placed"
# Makes the outputs along pieces of path in a folder that holds the frames' disparities.
Make = Callable[[Path, Sequence[Piece]], object]


@dataclass(frozen=True)
class Trial:
    """What the frames that were tried took.

    Args:
        frames: how many passed.
        matching_s: CPU time of a frame.
        odometry_s: CPU time of a frame, loops looked for.
        map_s: wall time of a frame in the second pass; None where none could be placed.
        work_bytes: of a frame, until the run is done.
        map_bytes: of all that was made along them, and what one more frame adds.
    """

    frames: int
    matching_s: float
    odometry_s: float
    map_s: float | None
    work_bytes: float
    map_bytes: tuple[int, float]


@dataclass(frozen=True)
class MapRehearsal:
    """What a map will take, estimated from a few frames.

    Args:
        whole: all of it that is estimated.
        matching_s: time of matching on all workers.
        odometry_s: time of odometry beside matching, loops looked for.
        map_s: time of the second pass; None where it could not be tried.
        work_bytes: that are there until the run is done.
        map_bytes: of its outputs, where all the way is on new ground; None where not tried.
        not_estimated: what it takes besides.
    """

    whole: Rehearsal
    matching_s: float
    odometry_s: float
    map_s: float | None
    work_bytes: int
    map_bytes: int | None
    not_estimated: tuple[str, ...]

    @classmethod
    def of(
        cls, trial: Trial, *, frames: int, workers: int, folder: Path, besides: Sequence[str]
    ) -> Self:
        """What was tried, scaled up to `frames` frames."""
        matching_s = frames * trial.matching_s / workers
        odometry_s = frames * trial.odometry_s
        map_s = None if trial.map_s is None else frames * trial.map_s
        first, more = trial.map_bytes
        map_bytes = None if map_s is None else round(first + more * max(0, frames - trial.frames))
        work_bytes = round(frames * trial.work_bytes)
        # Odometry goes on in order while others are matched, on the same cores.
        passed_s = max(odometry_s, matching_s + odometry_s / workers)
        whole = Rehearsal(
            frames,
            work_bytes + (map_bytes or 0),
            passed_s + (map_s or 0.0),
            free_bytes(folder),
            folder,
        )
        tried = () if trial.frames else (NONE_PASSED,)
        unknown = (*besides, *tried, *((NOT_PLACED,) if map_s is None else ()))
        return cls(whole, matching_s, odometry_s, map_s, work_bytes, map_bytes, unknown)

    @property
    def exit_code(self) -> int:
        """0."""
        return self.whole.exit_code

    def checked(self) -> Self:
        """Itself, if what is estimated will fit on the disk.

        Raises:
            OutputError: it will not.
        """
        self.whole.checked()
        return self

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values: the whole, then its parts."""
        return {
            **self.whole.as_dict(),
            "matching_s": round(self.matching_s, 1),
            "odometry_s": round(self.odometry_s, 1),
            "map_s": None if self.map_s is None else round(self.map_s, 1),
            "work_bytes": self.work_bytes,
            "map_bytes": self.map_bytes,
            "not_estimated": list(self.not_estimated),
        }

    def text(self) -> str:
        """The whole for people, and a line for each part."""
        lines = [
            self.whole.text(),
            f"  matching: {self.matching_s:.0f} s; {self.work_bytes / MEGABYTE:.0f} MB until the "
            "run is done",
            f"  odometry: {self.odometry_s:.0f} s, beside matching",
        ]
        if self.map_s is not None and self.map_bytes:  # none is wanted with --to none
            lines.append(
                f"  the map along the path: {self.map_s:.0f} s, {self.map_bytes / MEGABYTE:.0f} MB "
                "where all the way is new ground"
            )
        return "\n".join([*lines, f"  not estimated: {', '.join(self.not_estimated)}"])


def rehearse_map(
    source: FrameSource,
    match_once: MatchOnce,
    walk: Walk,
    make: Make,
    *,
    folder: Path,
    crew: CrewPlan,
    besides: Sequence[str],
) -> MapRehearsal:
    """Map a few frames from the midst of `source` for nothing, and scale up.

    Args:
        source: what the run will read.
        match_once: what each frame will pass.
        walk: begun.
        make: what will be done along the path.
        folder: where the run will write.
        crew: what it will match with.
        besides: what the run takes that nobody estimates.

    Raises:
        ScanMissing, SequenceTime: frames that the run would stop at.
        MemoryLimit, OutputError: the outputs of these few do not fit already.
    """
    with tempfile.TemporaryDirectory(prefix="pseudolidar-") as scratch:
        alone = replace(crew, workers=1)
        trial = _tried(source, match_once, walk, make, Path(scratch), crew=alone)
    return MapRehearsal.of(
        trial, frames=len(source.ids), workers=crew.count, folder=folder, besides=besides
    )


def _tried(
    source: FrameSource,
    match_once: MatchOnce,
    walk: Walk,
    make: Make,
    scratch: Path,
    *,
    crew: CrewPlan,
) -> Trial:
    begin = max(0, (len(source.ids) - TRIED) // 2)
    others = frozenset(source.ids) - frozenset(source.ids[begin : begin + TRIED])
    (scratch / WORK_FOLDER).mkdir()
    matching_s, odometry_s = list[float](), list[float]()
    early: tuple[Piece, ...] = ()
    for frame in stream(source, match_once, crew=crew, skip=others):
        if not isinstance(frame, Done):
            continue
        begun_s = time.thread_time()
        _step(walk, frame.value, scratch)
        odometry_s.append(time.thread_time() - begun_s)
        matching_s.append(frame.cpu_s)
        if len(odometry_s) == TRIED - LAST and others:
            early = _pieces(walk)
    before = _made(make, scratch, early)[1] if early else 0
    pieces = _pieces(walk)
    seconds, size = _made(make, scratch, pieces)
    count = len(odometry_s)
    added = count - (TRIED - LAST) if early else 0
    more = (size - before) / added if added else size / max(1, count)
    return Trial(
        count,
        _usual(matching_s),
        _usual(odometry_s),
        seconds / len(pieces[0].frames) if pieces else None,
        _bytes_below(scratch / WORK_FOLDER) / max(1, count),
        (size, max(0.0, more)),
    )


def _step(walk: Walk, matched: MatchedFrame, scratch: Path) -> None:
    walk.step(matched.frame, matched.disparity, matched.movable)
    for file in matched.product.files:
        inside(scratch, file.name).write_bytes(file.data)


def _pieces(walk: Walk) -> tuple[Piece, ...]:
    try:
        return walk.walked().pieces
    except OdometryLost:
        return ()


def _made(make: Make, scratch: Path, pieces: Sequence[Piece]) -> tuple[float, int]:
    """Wall time of making the outputs, and their size."""
    begun_s = time.monotonic()
    make(scratch, pieces)
    seconds = time.monotonic() - begun_s
    return seconds, _bytes_below(scratch) - _bytes_below(scratch / WORK_FOLDER)


def _usual(seconds: Sequence[float]) -> float:
    """Of a frame, once everything is loaded."""
    warm = seconds[WARMING:] or seconds[-1:]
    return median(warm) if warm else 0.0


def _bytes_below(folder: Path) -> int:
    return sum(
        (Path(place) / name).stat().st_size for place, _, names in os.walk(folder) for name in names
    )
