"""How the frames of a run are done: by how many workers, and of which kind."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from pseudolidar.errors import UsageError
from pseudolidar.running.crew.attempt import AnyFrame, NewResult
from pseudolidar.running.crew.crew import Crew, InThread, Worker
from pseudolidar.running.crew.in_flight import InFlight
from pseudolidar.sources.source import FrameSequence

# Longest time that a frame may take. The slowest that is known is the first one of a new
# installation, which compiles the kernels: 30 s.
FRAME_TIMEOUT_S = 120.0


@dataclass(frozen=True)
class CrewPlan:
    """How frames are done; no byte of a result depends on it.

    Args:
        workers: frames done at the same time; None for one per core.
        timeout_s: a frame that takes longer is skipped.
        isolate: in processes of their own, which may crash, instead of threads.
        memory_limit_mb: what such a process may hold; None for no limit.

    Raises:
        UsageError: less than one worker, no time, or a limit where nothing is isolated.
    """

    workers: int | None = None
    timeout_s: float = FRAME_TIMEOUT_S
    isolate: bool = False
    memory_limit_mb: float | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise UsageError(f"{self.workers} workers", want="at least 1", where="--workers")
        if not self.timeout_s > 0:
            raise UsageError(f"{self.timeout_s:g} s", want="more than 0", where="--timeout")
        if self.memory_limit_mb is not None and not self.isolate:
            raise UsageError(
                "a memory limit without processes",
                want="frames in processes",
                fix="Add --isolate.",
                where="--memory-limit",
            )
        if self.memory_limit_mb is not None and not self.memory_limit_mb > 0:
            raise UsageError(
                f"{self.memory_limit_mb:g} MB", want="more than 0", where="--memory-limit"
            )

    @property
    def count(self) -> int:
        """Number of workers."""
        return self.workers or default_workers()

    def crew(
        self,
        source: FrameSequence[AnyFrame],
        per_frame: Callable[[AnyFrame], NewResult],
        *,
        frames: int,
        in_flight: InFlight | None = None,
    ) -> Crew[NewResult]:
        """The workers for `frames` frames of `source`.

        Args:
            source: what to read.
            per_frame: what to do with a frame.
            frames: how many there are to do.
            in_flight: where frames are noted that this process itself does.

        Raises:
            UsageError: they shall be processes, and the work cannot be sent to one.
        """
        hire: Callable[[], Worker[NewResult]]
        if self.isolate:
            from pseudolidar.running.crew.isolated import Isolation

            hire = Isolation(source, per_frame, memory_limit_mb=self.memory_limit_mb).hire
        else:
            in_thread = InThread(source, per_frame, in_flight)

            def hire() -> Worker[NewResult]:
                return in_thread

        return Crew(hire, min(self.count, max(1, frames)), timeout_s=self.timeout_s)


def default_workers() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
