"""How a live run goes: rates, latencies and what became of every picture."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.running.live.latencies import Latencies
from pseudolidar.sources.capture.cameras import Capture
from pseudolidar.sources.capture.counts import CaptureCounts

# The rate that is shown is that of so many of the last frames.
RECENT = 50
MEDIAN, MOST = 0.5, 0.95


@dataclass(frozen=True)
class LiveFigures:
    """How a live run stands.

    Args:
        seconds: since the first pair could be taken.
        frames: that were finished.
        skipped: that could not be used.
        rate_hz: frames finished per second, of all; None before there are two.
        recent_hz: the same of the last ones.
        latency_p50_s: from the moment of the pictures to when all of the frame is durable, median.
        latency_p95_s: the same of the slowest 5 %.
        counts: what became of the pictures.
        slipped_s: how far played videos fell behind their pace.
    """

    seconds: float
    frames: int
    skipped: int
    rate_hz: float | None
    recent_hz: float | None
    latency_p50_s: float | None
    latency_p95_s: float | None
    counts: CaptureCounts
    slipped_s: float

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "seconds": round(self.seconds, 3),
            "frames": self.frames,
            "rate_hz": self.rate_hz,
            "latency_p50_s": self.latency_p50_s,
            "latency_p95_s": self.latency_p95_s,
            "slipped_s": round(self.slipped_s, 3),
            **self.counts.as_dict(),
        }


@dataclass(eq=False)
class Meter:
    """Takes the time of frames as they are finished.

    Args:
        capture: the cameras.
    """

    capture: Capture
    skipped: int = 0
    _latencies: Latencies = field(default_factory=Latencies)
    _done_s: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    _begun_s: float = field(default_factory=time.monotonic)
    _first_s: float | None = None
    _last_s: float | None = None

    def begin(self) -> None:
        """Pairs can be taken from now on."""
        self._begun_s = time.monotonic()

    def done(self, taken_ns: int) -> float:
        """A frame is finished whose pictures were taken at this monotonic time; its latency, s."""
        now_ns = time.monotonic_ns()
        latency_s, now_s = (now_ns - taken_ns) / NS_PER_S, now_ns / NS_PER_S
        self._latencies.add(latency_s)
        self._done_s.append(now_s)
        self._first_s = now_s if self._first_s is None else self._first_s
        self._last_s = now_s
        return latency_s

    @property
    def figures(self) -> LiveFigures:
        """How it stands."""
        frames = len(self._latencies)
        return LiveFigures(
            seconds=(self._last_s or time.monotonic()) - self._begun_s,
            frames=frames,
            skipped=self.skipped,
            rate_hz=_rate(frames, self._first_s, self._last_s),
            recent_hz=_rate(len(self._done_s), *_ends(self._done_s)),
            latency_p50_s=self._latencies.quantile_s(MEDIAN),
            latency_p95_s=self._latencies.quantile_s(MOST),
            counts=self.capture.counts,
            slipped_s=self.capture.slipped_s,
        )


def _rate(frames: int, first_s: float | None, last_s: float | None) -> float | None:
    if frames < 2 or first_s is None or last_s is None or last_s <= first_s:
        return None
    return (frames - 1) / (last_s - first_s)


def _ends(times_s: deque[float]) -> tuple[float | None, float | None]:
    return (times_s[0], times_s[-1]) if times_s else (None, None)
