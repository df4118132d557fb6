"""Pictures of two cameras put together by time; of the pairs that wait the newest win.

The buffer is where the threads of the cameras meet those that work on pairs. It holds a few
pictures and no more, however slow the workers are: what they cannot take is dropped and counted.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.errors import (
    CameraStalled,
    CaptureEnded,
    EyesApart,
    PseudolidarError,
    SourceEmpty,
)
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.capture.counts import CaptureCounts, EyeCounts
from pseudolidar.sources.capture.stamps import Stamp

if TYPE_CHECKING:
    from av import VideoFrame

# Pictures of one eye that wait for the other one's.
MOST_WAITING = 8
# Without a tolerance: a share of the interval of the faster camera, and never more than this. The
# same as for recorded videos.
TOLERANCE_OF_INTERVAL, LARGEST_TOLERANCE_NS = 0.25, NS_PER_S // 100
# Beyond half an interval another picture is nearer.
NEAREST_OF_INTERVAL = 0.5
# Intervals that the rate of a camera is found from.
INTERVALS_SEEN = 9
# After so many pictures of both eyes without a single pair they will never meet.
TRIED_WITHOUT_A_PAIR = 30
# How often a wait is interrupted to see whether a camera is still there.
LOOK_S = 0.2
_NAMES = ("left", "right")


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture of one camera.

    Args:
        picture: as decoded.
        stamp: when it was taken.
    """

    picture: VideoFrame
    stamp: Stamp


@dataclass(frozen=True, eq=False)
class ShotPair:
    """Pictures of one moment.

    Args:
        shots: left and right; one that holds both eyes alone.
    """

    shots: tuple[Shot, ...]

    @property
    def time_ns(self) -> int:
        """The left eye's time counts, as for recorded videos."""
        return self.shots[0].stamp.time_ns

    @property
    def taken_ns(self) -> int:
        """Monotonic time at which the pair was complete."""
        return max(shot.stamp.taken_ns for shot in self.shots)

    @property
    def apart_ns(self) -> int:
        """Difference of the times of both eyes."""
        return abs(self.shots[-1].stamp.time_ns - self.time_ns)


@dataclass(eq=False)
class _Eye:
    """One camera, as the buffer sees it."""

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
        return float(np.median(self.intervals_ns)) if self.intervals_ns else np.inf


class PairBuffer:
    """Pairs by time, the newest of them; thread-safe.

    Args:
        eyes: 2, or 1 where a camera's pictures hold both.
        tolerance_s: largest difference within a pair; None for a quarter of the interval, at most
            10 ms. Beyond half an interval it has no meaning.
        kept: pairs that wait for a worker.
        patience_s: longest time without a picture.
    """

    def __init__(
        self, eyes: int, *, tolerance_s: float | None, kept: int, patience_s: float
    ) -> None:
        now_s = time.monotonic()
        self._eyes = [_Eye(name, now_s) for name in (_NAMES[:eyes] if eyes > 1 else ("camera",))]
        self._tolerance_s, self._patience_s, self._kept = tolerance_s, patience_s, kept
        self._pairs: deque[ShotPair] = deque()
        self._formed = self._dropped = self._taken = 0
        self._widest_ns = 0
        self._error: BaseException | None = None
        self._stopped = False
        self._changed = threading.Condition()

    # --- for the cameras -------------------------------------------------------------------

    def put(self, eye: int, shot: Shot) -> None:
        """A picture has arrived."""
        with self._changed:
            one = self._eyes[eye]
            one.seen_s, one.fault, one.latest = time.monotonic(), None, shot
            one.arrived += 1
            time_ns = shot.stamp.time_ns
            if one.last_ns is not None:
                if time_ns <= one.last_ns:  # a clock that was set back: it pairs with nothing
                    one.alone += 1
                    return
                one.intervals_ns.append(time_ns - one.last_ns)
            one.last_ns = time_ns
            one.waiting.append(shot)
            self._put_together()
            while len(one.waiting) > MOST_WAITING:
                one.waiting.popleft()
                one.alone += 1
            self._changed.notify_all()

    def damaged(self, eye: int, reason: str) -> None:
        """A picture has arrived that is not whole."""
        with self._changed:
            self._eyes[eye].damaged += 1
            self._eyes[eye].damage = reason

    def failed(self, eye: int, error: PseudolidarError) -> None:
        """A camera is gone; it is tried again."""
        with self._changed:
            self._eyes[eye].fault = error

    def reopened(self, eye: int) -> None:
        """A camera is there again."""
        with self._changed:
            self._eyes[eye].reopened += 1

    def ended(self, eye: int) -> None:
        """A video is played to its end."""
        with self._changed:
            self._eyes[eye].ended = True
            self._put_together()
            self._changed.notify_all()

    def fail(self, error: BaseException) -> None:
        """Nothing more will come, and this is why."""
        with self._changed:
            self._error = self._error or error
            self._changed.notify_all()

    # --- for the workers -------------------------------------------------------------------

    def take(self, deadline_s: float | None = None) -> ShotPair:
        """The pair that has waited longest; waits for one.

        Args:
            deadline_s: monotonic time at which to stop waiting.

        Raises:
            CaptureEnded: stopped, played to the end, or past the deadline.
            CameraFault: a camera gives nothing any more.
            EyesApart: no two pictures are of one moment.
        """
        with self._changed:
            while not self._pairs:
                self._check()
                left_s = np.inf if deadline_s is None else deadline_s - time.monotonic()
                if left_s <= 0:
                    raise CaptureEnded("the time is over")
                self._changed.wait(min(LOOK_S, left_s))
            if self._stopped:
                raise CaptureEnded("stopped")
            self._taken += 1
            return self._pairs.popleft()

    def seen(self) -> ShotPair:
        """The last picture of each camera, of whatever moment; waits for one, takes none.

        Raises:
            CaptureEnded, CameraFault: as `take`.
        """
        with self._changed:
            while any(eye.latest is None for eye in self._eyes):
                self._check()
                self._changed.wait(LOOK_S)
            return ShotPair(tuple(eye.latest for eye in self._eyes if eye.latest is not None))

    def forget(self) -> None:
        """Begin to count: what came so far was only looked at."""
        with self._changed:
            self._pairs.clear()
            self._formed = self._dropped = self._taken = self._widest_ns = 0
            for eye in self._eyes:
                eye.waiting.clear()
                eye.arrived = eye.alone = eye.damaged = eye.reopened = 0
                eye.damage = ""

    def date_anew(self, taken_ns: int) -> None:
        """The pictures that wait count as taken now: videos were held until here."""
        with self._changed:
            for eye in self._eyes:
                eye.waiting = deque(_taken(shot, taken_ns) for shot in eye.waiting)
            self._pairs = deque(
                ShotPair(tuple(_taken(shot, taken_ns) for shot in pair.shots))
                for pair in self._pairs
            )

    def stop(self) -> None:
        """Nobody wants more pairs; may be called by a signal's handler in any thread."""
        self._stopped = True  # seen within LOOK_S: a handler must not wait for a lock

    @property
    def counts(self) -> CaptureCounts:
        """What has become of every picture so far."""
        with self._changed:
            return CaptureCounts(
                eyes=tuple(_counts(eye) for eye in self._eyes),
                formed=self._formed,
                dropped=self._dropped,
                taken=self._taken,
                waiting=len(self._pairs),
                widest_ns=self._widest_ns,
            )

    def _check(self) -> None:
        """Raise if there will be no further pair."""
        if self._error is not None:
            raise self._error
        if self._stopped:
            raise CaptureEnded("stopped")
        ended = [eye for eye in self._eyes if eye.ended]
        if len(ended) == len(self._eyes) or any(not eye.waiting for eye in ended):
            raise self._played(ended)
        for eye in self._eyes:
            if time.monotonic() - eye.seen_s > self._patience_s:
                raise eye.fault or _stalled(eye.name, self._patience_s)
        fewest = min(eye.arrived for eye in self._eyes)
        if not self._formed and len(self._eyes) > 1 and fewest >= TRIED_WITHOUT_A_PAIR:
            raise self._apart(fewest)

    def _played(self, ended: Sequence[_Eye]) -> PseudolidarError:
        """What the end of a video means."""
        empty = [eye for eye in ended if not eye.arrived]
        if empty:
            return SourceEmpty(
                f"not one whole picture in the {empty[0].name} video"
                + (f": {empty[0].damage}" if empty[0].damage else ""),
                want="a video",
            )
        if not self._formed:
            return self._apart(min(eye.arrived for eye in self._eyes))
        return CaptureEnded("played to the end")

    def _apart(self, tried: int) -> EyesApart:
        known = [eye.nearest_ns for eye in self._eyes if eye.nearest_ns is not None]
        gap = f"{min(known) / 1e6:.3g} ms" if known else "far"
        return EyesApart(
            f"of {tried} pictures of each eye no two are of one moment: they are taken {gap} apart",
            want=f"pictures within {self._tolerance_ns / 1e6:.3g} ms",
            fix="Let one camera trigger the other; or, where nothing moves fast, allow more by "
            "--camera.tolerance-s (at most half an interval).",
        )

    def _put_together(self) -> None:
        """Form every pair that the waiting pictures allow."""
        if len(self._eyes) == 1:
            while self._eyes[0].waiting:
                self._add(ShotPair((self._eyes[0].waiting.popleft(),)))
            return
        left, right = self._eyes
        rates_known = left.intervals_ns and right.intervals_ns
        if not rates_known and not (left.ended or right.ended):
            return  # how near is near enough cannot be told yet
        tolerance_ns = self._tolerance_ns
        while left.waiting and right.waiting:
            gap_ns = right.waiting[0].stamp.time_ns - left.waiting[0].stamp.time_ns
            if abs(gap_ns) <= tolerance_ns:
                self._add(ShotPair((left.waiting.popleft(), right.waiting.popleft())))
                continue
            # Pictures of one eye come in order: the earlier of the two has missed its partner.
            early = left if gap_ns > 0 else right
            early.waiting.popleft()
            early.alone += 1
            early.nearest_ns = abs(gap_ns)

    def _add(self, pair: ShotPair) -> None:
        self._formed += 1
        self._widest_ns = max(self._widest_ns, pair.apart_ns)
        self._pairs.append(pair)
        while len(self._pairs) > self._kept:
            self._pairs.popleft()
            self._dropped += 1

    @property
    def _tolerance_ns(self) -> float:
        interval_ns = min(eye.interval_ns for eye in self._eyes)
        if self._tolerance_s is None:
            wanted_ns = min(LARGEST_TOLERANCE_NS, TOLERANCE_OF_INTERVAL * interval_ns)
        else:
            wanted_ns = self._tolerance_s * NS_PER_S
        return min(wanted_ns, NEAREST_OF_INTERVAL * interval_ns)


def _taken(shot: Shot, taken_ns: int) -> Shot:
    return replace(shot, stamp=shot.stamp._replace(taken_ns=taken_ns))


def _counts(eye: _Eye) -> EyeCounts:
    return EyeCounts(
        name=eye.name,
        arrived=eye.arrived,
        alone=eye.alone,
        damaged=eye.damaged,
        damage=eye.damage,
        reopened=eye.reopened,
        waiting=len(eye.waiting),
        fault="" if eye.fault is None else eye.fault.got,
        interval_s=eye.interval_ns / NS_PER_S if eye.intervals_ns else None,
    )


def _stalled(name: str, patience_s: float) -> CameraStalled:
    return CameraStalled(
        f"no picture for {patience_s:g} s",
        want="a camera that gives pictures",
        fix="Unplug the camera and plug it in again; wait longer with --camera.patience-s.",
        where=f"{name} camera" if name != "camera" else "",
    )
