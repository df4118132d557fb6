"""Pairs of two cameras between their threads and those that work on them: the newest win.

The buffer is where the threads of the cameras meet those that work on pairs. It holds a few
pictures and no more, however slow the workers are: what they cannot take is dropped and counted.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from pseudolidar.errors import (
    CameraStalled,
    CaptureEnded,
    PseudolidarError,
    SourceEmpty,
)
from pseudolidar.sources.capture.counts import CaptureCounts
from pseudolidar.sources.capture.eye_pairing import Eye, EyePairing
from pseudolidar.sources.capture.shots import Shot, ShotPair

# After so many pictures of both eyes without a single pair they will never meet.
TRIED_WITHOUT_A_PAIR = 30
# How often a wait is interrupted to see whether a camera is still there.
LOOK_S = 0.2


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
        self._pairing = EyePairing(eyes, tolerance_s)
        self._eyes = self._pairing.eyes
        self._patience_s, self._kept = patience_s, kept
        self._pairs: deque[ShotPair] = deque()
        self._newest: ShotPair | None = None  # of all that were formed, taken or not
        self._formed = self._dropped = self._taken = 0
        self._widest_ns = 0
        self._error: BaseException | None = None
        self._stopped = False
        self._changed = threading.Condition()

    # --- for the cameras -------------------------------------------------------------------

    def put(self, eye: int, shot: Shot) -> None:
        """A picture has arrived."""
        with self._changed:
            self._add(self._pairing.put(eye, shot))
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
            self._add(self._pairing.end(eye))
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

    def pair_seen(self, within_s: float) -> ShotPair | None:
        """The newest pair of one moment; waits a while for one, takes none; None without one."""
        deadline_s = time.monotonic() + within_s
        with self._changed:
            while self._newest is None and not self._stopped:
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    break
                self._changed.wait(min(LOOK_S, left_s))
            return self._newest

    def forget(self) -> None:
        """Begin to count: what came so far was only looked at."""
        with self._changed:
            self._pairs.clear()
            self._formed = self._dropped = self._taken = self._widest_ns = 0
            for eye in self._eyes:
                eye.forget()

    def date_anew(self, taken_ns: int) -> None:
        """The pictures that wait count as taken now: videos were held until here."""
        with self._changed:
            self._pairing.date_anew(taken_ns)
            self._pairs = deque(
                ShotPair(tuple(shot.dated(taken_ns) for shot in pair.shots)) for pair in self._pairs
            )

    def stop(self) -> None:
        """Nobody wants more pairs; may be called by a signal's handler in any thread."""
        self._stopped = True  # seen within LOOK_S: a handler must not wait for a lock

    @property
    def counts(self) -> CaptureCounts:
        """What has become of every picture so far."""
        with self._changed:
            return CaptureCounts(
                eyes=tuple(eye.counts for eye in self._eyes),
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
            raise self._pairing.apart(fewest)

    def _played(self, ended: Sequence[Eye]) -> PseudolidarError:
        """What the end of a video means."""
        empty = [eye for eye in ended if not eye.arrived]
        if empty:
            return SourceEmpty(
                f"not one whole picture in the {empty[0].name} video"
                + (f": {empty[0].damage}" if empty[0].damage else ""),
                want="a video",
            )
        if not self._formed:
            return self._pairing.apart(min(eye.arrived for eye in self._eyes))
        return CaptureEnded("played to the end")

    def _add(self, formed: list[ShotPair]) -> None:
        """Keep the newest pairs."""
        for pair in formed:
            self._formed += 1
            self._widest_ns = max(self._widest_ns, pair.apart_ns)
            self._newest = pair
            self._pairs.append(pair)
            if len(self._pairs) > self._kept:
                self._pairs.popleft()
                self._dropped += 1


def _stalled(name: str, patience_s: float) -> CameraStalled:
    return CameraStalled(
        f"no picture for {patience_s:g} s",
        want="a camera that gives pictures",
        fix="Unplug the camera and plug it in again; wait longer with --camera.patience-s.",
        where=f"{name} camera" if name != "camera" else "",
    )
