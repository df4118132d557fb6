"""When a picture was taken: by the clock of the camera, of the stream, or of its arrival."""

from __future__ import annotations

import math
import threading
import time
from typing import NamedTuple, Protocol

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.stamps import START_NS

# A driver's stamp is by this machine's monotonic or wall clock if it is so near to it.
SAME_CLOCK_NS = 60 * NS_PER_S
# A played video that falls behind by more than this goes on from there: a camera that is slower.
SLIP_NS = NS_PER_S // 4
# Pictures that one eye of played videos may be ahead of the other.
INTERVALS_AHEAD = 3
# How often a wait is interrupted to see whether it is still wanted.
LOOK_S = 0.2


class Stamp(NamedTuple):
    """When a picture was taken.

    Args:
        time_ns: by the clock that the pairs are stamped with.
        taken_ns: the same moment by the monotonic clock of this machine, for the latency.
    """

    time_ns: int
    taken_ns: int


class Clock(Protocol):
    """Stamps the pictures of one camera as they arrive."""

    def stamp(self, media_ns: int | None) -> Stamp:
        """When a picture was taken that its stream dates `media_ns` (None: not at all)."""

    def begin(self) -> None:
        """The camera was opened, or opened again."""

    def end(self) -> None:
        """The camera was closed."""


class Epoch:
    """What the clocks of both eyes share: they are never set against each other.

    The wall clock is read once: where it is set while the cameras run, times still increase.
    """

    def __init__(self) -> None:
        self.wall_ns = time.time_ns() - time.monotonic_ns()  # add to a monotonic time
        self._lock = threading.Lock()
        self._shift_ns: int | None = None

    def shift_ns(self, media_ns: int) -> int:
        """What is added to the times of streams; the first picture of either eye decides."""
        with self._lock:
            if self._shift_ns is None:
                self._shift_ns = time.monotonic_ns() + self.wall_ns - media_ns
            return self._shift_ns


class ArrivalClock:
    """A picture was taken when it arrived.

    Args:
        epoch: of both eyes.
    """

    def __init__(self, epoch: Epoch) -> None:
        self._epoch = epoch

    def stamp(self, media_ns: int | None) -> Stamp:  # noqa: ARG002 - a protocol's argument
        """Now."""
        taken_ns = time.monotonic_ns()
        return Stamp(taken_ns + self._epoch.wall_ns, taken_ns)

    def begin(self) -> None:
        """Nothing changes."""

    def end(self) -> None:
        """Nothing changes."""


class DriverClock:
    """Stamps of a driver: when the sensor was read, by the monotonic or wall clock.

    Args:
        epoch: of both eyes.
    """

    def __init__(self, epoch: Epoch) -> None:
        self._epoch, self._arrival = epoch, ArrivalClock(epoch)

    def stamp(self, media_ns: int | None) -> Stamp:
        """As the driver says, or now where it says nothing that could be meant."""
        arrived = self._arrival.stamp(media_ns)
        if media_ns is not None:
            if abs(media_ns - arrived.taken_ns) < SAME_CLOCK_NS:
                return Stamp(media_ns + self._epoch.wall_ns, media_ns)
            if abs(media_ns - arrived.time_ns) < SAME_CLOCK_NS:
                return Stamp(media_ns, media_ns - self._epoch.wall_ns)
        return arrived

    def begin(self) -> None:
        """Nothing changes."""

    def end(self) -> None:
        """Nothing changes."""


class StreamClock:
    """Times inside a stream, of two streams that share a clock.

    A stream that begins anew with an earlier time is taken to go on after the time that passed.

    Args:
        epoch: of both eyes.
    """

    def __init__(self, epoch: Epoch) -> None:
        self._epoch, self._arrival = epoch, ArrivalClock(epoch)
        self._own_ns = 0  # added since the camera began anew
        self._last: Stamp | None = None
        self._restarted = False

    def stamp(self, media_ns: int | None) -> Stamp:
        """By the stream's clock, moved so that the first picture was taken when it arrived."""
        arrived = self._arrival.stamp(media_ns)
        if media_ns is None:
            return arrived
        time_ns = media_ns + self._epoch.shift_ns(media_ns) + self._own_ns
        if self._restarted and self._last is not None and time_ns <= self._last.time_ns:
            gone_ns = max(1, arrived.taken_ns - self._last.taken_ns)
            self._own_ns += self._last.time_ns + gone_ns - time_ns
            time_ns = self._last.time_ns + gone_ns
        self._restarted = False
        self._last = Stamp(time_ns, arrived.taken_ns)
        return self._last

    def begin(self) -> None:
        """The next picture may begin a new count."""
        self._restarted = True

    def end(self) -> None:
        """Nothing changes."""


class Pace:
    """When the pictures of played videos are due; both eyes share one and are played in step.

    The first picture of each video is there at once; the others wait until `begin`.

    Args:
        eyes: how many are played.
        speed: 1 for the pace of the videos.
        stop: set when there is no more need to wait.
    """

    def __init__(self, eyes: int, speed: float, stop: threading.Event) -> None:
        self._speed, self._stop = speed, stop
        self._moved = threading.Condition()
        self._at = [-math.inf] * eyes  # what each eye plays, by the clock of the videos
        self._first_ns: int | None = None  # the first picture of all, by that clock
        self._zero_ns: float | None = None  # monotonic time at which that clock is 0
        self.slipped_ns = 0  # how far the videos have fallen behind in all

    def begin(self) -> None:
        """Play."""
        with self._moved:
            first_ns = 0 if self._first_ns is None else self._first_ns
            self._zero_ns = time.monotonic_ns() - first_ns / self._speed
            self._moved.notify_all()

    def wait(self, eye: int, media_ns: int, ahead_ns: int) -> int:
        """Wait until a picture is due; the monotonic time of that.

        Args:
            eye: whose picture it is.
            media_ns: when it is shown.
            ahead_ns: how far this eye may be ahead of the other one, which reads more slowly.
        """
        with self._moved:
            first, self._at[eye] = self._at[eye] == -math.inf, media_ns
            self._first_ns = media_ns if self._first_ns is None else self._first_ns
            self._moved.notify_all()
            while not first and not self._stop.is_set():
                if self._zero_ns is not None and min(self._at) >= media_ns - ahead_ns:
                    break
                self._moved.wait(LOOK_S)
            now = time.monotonic_ns()
            if self._zero_ns is None:
                return now
            due = round(self._zero_ns + media_ns / self._speed)
            if now - due > SLIP_NS:
                self._zero_ns += now - due
                self.slipped_ns += now - due
                due = now
        if due > now:
            self._stop.wait((due - now) / NS_PER_S)
        return due

    def leave(self, eye: int) -> None:
        """An eye is played to its end: the other one need not wait for it."""
        with self._moved:
            self._at[eye] = math.inf
            self._moved.notify_all()


class PlayClock:
    """Stamps of a played video: its own times, 1 s later, as nothing is stamped 0.

    Args:
        pace: of both eyes.
        eye: which of them.
        interval_ns: of its pictures, where they are not dated.
    """

    def __init__(self, pace: Pace, eye: int, interval_ns: int) -> None:
        self._pace, self._eye, self._interval_ns = pace, eye, interval_ns
        self._last_ns = -interval_ns

    def stamp(self, media_ns: int | None) -> Stamp:
        """Waits until the picture is due."""
        self._last_ns = self._last_ns + self._interval_ns if media_ns is None else media_ns
        ahead_ns = INTERVALS_AHEAD * self._interval_ns
        return Stamp(self._last_ns + START_NS, self._pace.wait(self._eye, self._last_ns, ahead_ns))

    def begin(self) -> None:
        """A video is played once."""

    def end(self) -> None:
        """It is over."""
        self._pace.leave(self._eye)
