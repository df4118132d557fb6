"""The bars of long work, on standard error, and only where a person looks at it."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from rich.progress import Progress


class _Bar:
    """What bars have in common: they are shown while the work is inside `with`."""

    _progress: Progress

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()


class FrameProgress(_Bar):
    """A bar with frames, rate, time left and skipped frames; nothing where nobody looks.

    Args:
        total: frames of the run.
        done: frames that an earlier run has committed.
        what: what is counted.
    """

    def __init__(self, total: int, *, done: int = 0, what: str = "frames") -> None:
        from pseudolidar.running.progress_bars import frame_bar

        self._skipped = 0
        self._progress = frame_bar()
        self._task = self._progress.add_task(what, total=total, completed=done, skipped="")

    def advance(self) -> None:
        """One more frame is committed."""
        self._progress.advance(self._task)

    def skip(self) -> None:
        """One more frame is skipped."""
        self._skipped += 1
        self._progress.update(self._task, advance=1, skipped=f"{self._skipped} skipped")


class ByteProgress(_Bar):
    """A bar with the bytes of a file; nothing where nobody looks.

    Args:
        total: bytes of the file.
        what: what is done to them.
    """

    def __init__(self, total: int, what: str) -> None:
        from pseudolidar.running.progress_bars import byte_bar

        self._progress = byte_bar()
        self._task = self._progress.add_task(what, total=total)

    def reached(self, position: int) -> None:
        """The work has come to this byte."""
        if not self._progress.disable:
            self._progress.update(self._task, completed=position)


class TimeProgress(_Bar):
    """A bar with the time that is used up, and what was found so far; nothing where nobody looks.

    Args:
        seconds: that may be used.
        what: what is done.
    """

    def __init__(self, seconds: float, what: str) -> None:
        from pseudolidar.running.progress_bars import time_bar

        self._progress = time_bar()
        self._task = self._progress.add_task(what, total=seconds, said="")

    def used(self, seconds: float, said: str) -> None:
        """So much is used up, and that is what there is to say."""
        self._progress.update(self._task, completed=seconds, said=said)
