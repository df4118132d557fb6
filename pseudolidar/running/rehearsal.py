"""A frame or two in memory, to tell before a run what it will take."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from pseudolidar.errors import OutputError
from pseudolidar.formats.atomic import free_bytes
from pseudolidar.running.crew.attempt import AnyFrame, Done, Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.products.product import Product
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSequence

# Frames tried, from the first to the last, until enough have passed. The first one also warms the
# kernels up, so it takes a second one to tell the time.
TRIES, WANTED = 5, 2
MEGABYTE = 1e6


@dataclass(frozen=True)
class Rehearsal:
    """What a run will take, estimated from a frame or two.

    Args:
        frames: frames to do.
        bytes: size of their files.
        seconds: time on all workers.
        free: bytes on the disk of the output folder.
        folder: output folder.
    """

    frames: int
    bytes: int
    seconds: float
    free: int
    folder: Path
    exit_code: int = 0

    def checked(self) -> Self:
        """Itself, if the run will fit on the disk.

        Raises:
            OutputError: it will not.
        """
        if self.bytes > self.free:
            raise OutputError(
                f"{self.frames} frames will take about {self.bytes} bytes, {self.free} are free",
                want="enough room on the disk",
                fix="Free some space, choose another disk, or ask for fewer frames or formats.",
                path=self.folder,
            )
        return self

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        figures = {"frames": self.frames, "bytes": self.bytes, "free_bytes": self.free}
        return {"dry_run": True, **figures, "seconds": round(self.seconds, 1)}

    def text(self) -> str:
        """One line for people."""
        return (
            f"dry run: {self.frames} frames, about {self.bytes / MEGABYTE:.0f} MB and "
            f"{self.seconds:.0f} s; {self.free / MEGABYTE:.0f} MB are free in {self.folder}"
        )


def rehearse(
    source: FrameSequence[AnyFrame],
    per_frame: Callable[[AnyFrame], Product],
    *,
    folder: Path,
    crew: CrewPlan,
) -> Rehearsal:
    """Do a frame or two of `source` without writing, and scale up; bad frames tell nothing.

    Args:
        source: what the run will read.
        per_frame: what it will do.
        folder: where it will write.
        crew: what it will do that with.
    """
    frames = len(source.ids)
    tried = frozenset(source.ids[:: max(1, frames // TRIES)])
    others = frozenset(source.ids) - tried
    sizes: list[int] = []
    seconds = 0.0
    alone = replace(crew, workers=1)
    for outcome in stream(source, per_frame, crew=alone, skip=others):
        if isinstance(outcome, Done):
            sizes.append(outcome.value.nbytes)
            seconds = outcome.cpu_s
        if len(sizes) == WANTED:
            break
    mean = sum(sizes) / len(sizes) if sizes else 0.0
    time_s = frames * seconds / crew.count
    return Rehearsal(frames, round(frames * mean), time_s, free_bytes(folder), folder)


def fitting(
    outcomes: Iterable[Done[Product] | Skipped], *, frames: int, folder: Path
) -> Iterator[Done[Product] | Skipped]:
    """Pass the outcomes on, if so many frames of the size of the first will fit on the disk.

    Raises:
        OutputError: they will not; before a frame is passed on, and so before it is written.
    """
    checked = False
    for outcome in outcomes:
        if isinstance(outcome, Done) and not checked:
            size = frames * outcome.value.nbytes
            Rehearsal(frames, size, 0.0, free_bytes(folder), folder).checked()
            checked = True
        yield outcome
