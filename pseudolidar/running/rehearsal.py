"""A frame or two in memory, to tell before a run what it will take."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pseudolidar.errors import OutputError
from pseudolidar.formats.atomic import free_bytes
from pseudolidar.running.product import Product
from pseudolidar.running.stream import AnyFrame, Done, attempt, default_workers
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
    workers: int | None = None,
    skip: Collection[str] = (),
    wanted: int = WANTED,
) -> Rehearsal:
    """Do a frame or two of `source` without writing, and scale up; bad frames tell nothing.

    Args:
        source: what the run will read.
        per_frame: what it will do.
        folder: where it will write.
        workers: threads it will use; None for one per core.
        skip: ids that are done already.
        wanted: frames to judge by; one is enough for the size.
    """
    todo = [index for index, name in enumerate(source.ids) if name not in skip]
    sizes: list[int] = []
    seconds = 0.0
    for index in todo[:: max(1, len(todo) // TRIES)]:
        begin_s = time.monotonic()
        outcome = attempt(source, per_frame, index)
        seconds = time.monotonic() - begin_s
        if isinstance(outcome, Done):
            sizes.append(outcome.value.nbytes)
        if len(sizes) == min(wanted, len(todo)):
            break
    mean = sum(sizes) / len(sizes) if sizes else 0.0
    free = free_bytes(folder)
    time_s = len(todo) * seconds / (workers or default_workers())
    return Rehearsal(len(todo), round(len(todo) * mean), time_s, free, folder)
