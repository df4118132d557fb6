"""How bars of progress look; apart from what moves them, as rich takes long to import."""

from __future__ import annotations

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


def frame_bar() -> Progress:
    """Frames, their rate, the time left, and the task's field `skipped`."""
    return _bar(
        MofNCompleteColumn(), _Rate(), TimeRemainingColumn(), TextColumn("{task.fields[skipped]}")
    )


def byte_bar() -> Progress:
    """Bytes, their rate and the time left."""
    return _bar(DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())


def time_bar() -> Progress:
    """Time that is used up of what may be, and the task's field `said`."""
    return _bar(TimeRemainingColumn(), TextColumn("{task.fields[said]}"))


def _bar(*columns: ProgressColumn) -> Progress:
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns,
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )


class _Rate(ProgressColumn):
    """Frames per second of this run."""

    def render(self, task: Task) -> Text:
        """`12.3/s`, or nothing before it is known."""
        return Text(f"{task.speed:.1f}/s" if task.speed else "")
