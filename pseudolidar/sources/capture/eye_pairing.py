"""Pictures of two eyes put together by time, as they arrive."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from pseudolidar.errors import EyesApart, PseudolidarError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.capture.counts import EyeCounts
from pseudolidar.sources.capture.shots import Shot, ShotPair

# Pictures of one eye that wait for the other one's.
MOST_WAITING = 8
# Without a tolerance: a share of the interval of the faster camera, and never more than this. The
# same as for recorded videos.
TOLERANCE_OF_INTERVAL, LARGEST_TOLERANCE_NS = 0.25, NS_PER_S // 100
# Beyond half an interval another picture is nearer.
NEAREST_OF_INTERVAL = 0.5
# Intervals that the rate of a camera is found from.
INTERVALS_SEEN = 9
_NAMES = ("left", "right")


@dataclass(eq=False)
class Eye:
    """One camera: what has come of it, and what of that waits for the other one."""

    name: str
    seen_s: float
    latest: Shot | None = None
    waiting: deque[Shot] = field(default_factory=deque)
    intervals_ns: deque[int] = field(default_factory=lambda: deque(maxlen=INTERVALS_SEEN))
    last_ns: int | None = None
    arrived: int = 0
    alone: int = 0
    damaged: int = 0
    damage: str = ""
    reopened: int = 0
    nearest_ns: int | None = None  # how near the other eye came to the last one alone
    fault: PseudolidarError | None = None
    ended: bool = False

    @property
    def interval_ns(self) -> float:
        """Usual time between pictures; infinite before there are two."""
        return float(np.median(self.intervals_ns)) if self.intervals_ns else np.inf

    @property
    def counts(self) -> EyeCounts:
        """What has become of its pictures."""
        return EyeCounts(
            name=self.name,
            arrived=self.arrived,
            alone=self.alone,
            damaged=self.damaged,
            damage=self.damage,
            reopened=self.reopened,
            waiting=len(self.waiting),
            fault="" if self.fault is None else self.fault.got,
            interval_s=self.interval_ns / NS_PER_S if self.intervals_ns else None,
        )

    def forget(self) -> None:
        """Begin to count."""
        self.waiting.clear()
        self.arrived = self.alone = self.damaged = self.reopened = 0
        self.damage = ""


class EyePairing:
    """The eyes and what waits of them; one thread at a time.

    Args:
        eyes: 2, or 1 where a camera's pictures hold both.
        tolerance_s: largest difference within a pair; None for a quarter of the interval, at most
            10 ms. Beyond half an interval it has no meaning.
    """

    def __init__(self, eyes: int, tolerance_s: float | None) -> None:
        now_s = time.monotonic()
        names = _NAMES[:eyes] if eyes > 1 else ("camera",)
        self.eyes = [Eye(name, now_s) for name in names]
        self._tolerance_s = tolerance_s

    def put(self, eye: int, shot: Shot) -> list[ShotPair]:
        """Pairs that a new picture makes possible."""
        one = self.eyes[eye]
        one.seen_s, one.fault, one.latest = time.monotonic(), None, shot
        one.arrived += 1
        time_ns = shot.stamp.time_ns
        if one.last_ns is not None:
            if time_ns <= one.last_ns:  # a clock that was set back: it pairs with nothing
                one.alone += 1
                return []
            one.intervals_ns.append(time_ns - one.last_ns)
        one.last_ns = time_ns
        one.waiting.append(shot)
        formed = self._put_together()
        while len(one.waiting) > MOST_WAITING:
            one.waiting.popleft()
            one.alone += 1
        return formed

    def end(self, eye: int) -> list[ShotPair]:
        """Pairs that are left once an eye is known to give no more."""
        self.eyes[eye].ended = True
        return self._put_together()

    def date_anew(self, taken_ns: int) -> None:
        """The pictures that wait count as taken at this monotonic time."""
        for eye in self.eyes:
            eye.waiting = deque(shot.dated(taken_ns) for shot in eye.waiting)

    def apart(self, tried: int) -> EyesApart:
        """Why of so many pictures no two are a pair."""
        known = [eye.nearest_ns for eye in self.eyes if eye.nearest_ns is not None]
        gap = f"{min(known) / 1e6:.3g} ms" if known else "far"
        return EyesApart(
            f"of {tried} pictures of each eye no two are of one moment: they are taken {gap} apart",
            want=f"pictures within {self._tolerance_ns / 1e6:.3g} ms",
            fix="Let one camera trigger the other; or, where nothing moves fast, allow more by "
            "--camera.tolerance-s (at most half an interval).",
        )

    def _put_together(self) -> list[ShotPair]:
        """Form every pair that the waiting pictures allow."""
        if len(self.eyes) == 1:
            single = [ShotPair((shot,)) for shot in self.eyes[0].waiting]
            self.eyes[0].waiting.clear()
            return single
        left, right = self.eyes
        rates_known = left.intervals_ns and right.intervals_ns
        if not rates_known and not (left.ended or right.ended):
            return []  # how near is near enough cannot be told yet
        tolerance_ns = self._tolerance_ns
        formed: list[ShotPair] = []
        while left.waiting and right.waiting:
            gap_ns = right.waiting[0].stamp.time_ns - left.waiting[0].stamp.time_ns
            if abs(gap_ns) <= tolerance_ns:
                formed.append(ShotPair((left.waiting.popleft(), right.waiting.popleft())))
                continue
            # Pictures of one eye come in order: the earlier of the two has missed its partner.
            early = left if gap_ns > 0 else right
            early.waiting.popleft()
            early.alone += 1
            early.nearest_ns = abs(gap_ns)
        return formed

    @property
    def _tolerance_ns(self) -> float:
        interval_ns = min(eye.interval_ns for eye in self.eyes)
        if self._tolerance_s is None:
            wanted_ns = min(LARGEST_TOLERANCE_NS, TOLERANCE_OF_INTERVAL * interval_ns)
        else:
            wanted_ns = self._tolerance_s * NS_PER_S
        return min(wanted_ns, NEAREST_OF_INTERVAL * interval_ns)
