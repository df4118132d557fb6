"""The table of a live run, on standard error while a person looks at it."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self

from pseudolidar.running.live.meter import LiveFigures, Meter

if TYPE_CHECKING:
    from rich.table import Table

REFRESH_HZ = 4


class LiveTable:
    """Rates, latencies and losses, renewed several times a second; nothing where nobody looks.

    Args:
        meter: what it shows.
        keys: what keys do, in words.
        says: what there is to say besides, at any moment; None for nothing.
    """

    def __init__(self, meter: Meter, keys: str = "", says: Callable[[], str] | None = None) -> None:
        from rich.console import Console
        from rich.live import Live

        console = Console(stderr=True)
        self._meter, self._keys, self._says = meter, keys, says
        self._live = (
            Live(
                get_renderable=self._table,
                console=console,
                refresh_per_second=REFRESH_HZ,
                transient=True,
            )
            if console.is_terminal
            else None
        )

    def advance(self) -> None:
        """The meter knows."""

    def skip(self) -> None:
        """A frame could not be used."""
        self._meter.skipped += 1

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def _table(self) -> Table:
        from rich import box
        from rich.table import Table

        table = Table(box=box.SIMPLE, show_header=False, caption=self._keys)
        says = () if self._says is None else (("board", self._says()),)
        for name, value in (*rows(self._meter.figures), *says):
            table.add_row(name, value.replace("[", r"\["))
        return table


def rows(figures: LiveFigures) -> list[tuple[str, str]]:
    """What the table and the report say, by name."""
    counts = figures.counts
    found = []
    for eye in counts.eyes:
        rate = "" if not eye.interval_s else f"{1 / eye.interval_s:.1f}/s, "
        losses = f"{eye.alone} alone, {eye.damaged} damaged"
        back = f", back {eye.reopened} times" if eye.reopened else ""
        fault = f"; now: {eye.fault}" if eye.fault else ""
        found.append((eye.name, f"{rate}{eye.arrived} pictures, {losses}{back}{fault}"))
    dropped = f"{counts.dropped} of {counts.formed} pairs"
    rate = "" if figures.rate_hz is None else f"{figures.rate_hz:.1f}/s, "
    recent = "" if figures.recent_hz is None else f"now {figures.recent_hz:.1f}/s, "
    skipped = f", {figures.skipped} skipped" if figures.skipped else ""
    found += [
        ("finished", f"{rate}{recent}{figures.frames} frames in {figures.seconds:.0f} s{skipped}"),
        ("latency", f"p50 {_ms(figures.latency_p50_s)}, p95 {_ms(figures.latency_p95_s)}"),
        ("dropped", dropped),
    ]
    if figures.slipped_s > 0:
        found.append(("videos", f"{figures.slipped_s:.1f} s behind their pace: decoded too slowly"))
    return found


def _ms(seconds: float | None) -> str:
    return "-" if seconds is None else f"{1000 * seconds:.0f} ms"
