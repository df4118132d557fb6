"""The bars of long work, on standard error, and only where a person looks at it."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)
from rich.text import Text


class FrameProgress:
    """A bar with frames, rate, time left and skipped frames; nothing where nobody looks.

    Args:
        total: frames of the run.
        done: frames that an earlier run has committed.
        what: what is counted.
    """

    def __init__(self, total: int, *, done: int = 0, what: str = "frames") -> None:
        console = Console(stderr=True)
        self._skipped = 0
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            _Rate(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[skipped]}"),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._task = self._progress.add_task(what, total=total, completed=done, skipped="")

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

    def advance(self) -> None:
        """One more frame is committed."""
        self._progress.advance(self._task)

    def skip(self) -> None:
        """One more frame is skipped."""
        self._skipped += 1
        self._progress.update(self._task, advance=1, skipped=f"{self._skipped} skipped")


class ByteProgress:
    """A bar with the bytes of a file; nothing where nobody looks.

    Args:
        total: bytes of the file.
        what: what is done to them.
    """

    def __init__(self, total: int, what: str) -> None:
        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            DownloadColumn(),
            TransferSpeedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._task = self._progress.add_task(what, total=total)

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

    def reached(self, position: int) -> None:
        """The work has come to this byte."""
        if not self._progress.disable:
            self._progress.update(self._task, completed=position)


class _Rate(ProgressColumn):
    """Frames per second of this run."""

    def render(self, task: Task) -> Text:
        """`12.3/s`, or nothing before it is known."""
        return Text(f"{task.speed:.1f}/s" if task.speed else "")
