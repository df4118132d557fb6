"""Which frame is shown when: play, pause, step, scrub, at a pace of one's choice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from pseudolidar.errors import StructureError

# Pauses of a recording are not waited for longer, s.
LONGEST_WAIT_S = 1.0
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0)


@dataclass
class Timeline:
    """A place in a sequence that moves by itself while it plays.

    Time is handed in, so that it can be told. While a frame is not ready the place does not move:
    playing gets slower and skips nothing.

    Args:
        times_s: (N,) when each frame was taken, not decreasing.
        index: what is shown.
        speed: how many times as fast as taken.
        loop: begin again after the last.
        playing: whether it moves.
    """

    times_s: Sequence[float]
    index: int = 0
    speed: float = 1.0
    loop: bool = True
    playing: bool = False
    _due_s: float = field(default=math.inf, init=False)

    def __post_init__(self) -> None:
        if not len(self.times_s):
            raise StructureError("no frames", want="at least one", where="Timeline")

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def last(self) -> int:
        """The last frame."""
        return len(self) - 1

    @property
    def following(self) -> int:
        """The frame after this one: after the last the first, or the last again."""
        return (self.index + 1) % len(self) if self.loop else min(self.index + 1, self.last)

    def play(self, now_s: float) -> None:
        """Move from now on; at the end from the first frame."""
        if self.index == self.last and not self.loop:
            self.index = 0
        self.playing = True
        self._due_s = now_s + self._wait_s()

    def pause(self) -> None:
        """Stay."""
        self.playing = False

    def jump(self, index: int, now_s: float) -> None:
        """Show that frame, the nearest there is."""
        self.index = min(max(index, 0), self.last)
        self._due_s = now_s + self._wait_s()

    def step(self, by: int, now_s: float) -> None:
        """Pause, and show a neighbour."""
        self.pause()
        target = self.index + by
        self.jump(target % len(self) if self.loop else target, now_s)

    def set_speed(self, speed: float, now_s: float) -> None:
        """Play faster or slower from now on."""
        if not 0 < speed < math.inf:
            raise StructureError(f"speed {speed:g}", want="above 0", where="Timeline")
        self.speed = speed
        self._due_s = min(self._due_s, now_s + self._wait_s())

    def due(self, now_s: float) -> bool:
        """Whether it is time for the following frame."""
        return self.playing and now_s >= self._due_s and self.following != self.index

    def advance(self, now_s: float) -> None:
        """Show the following frame: it is due, and ready."""
        self.index = self.following
        # A pace, not a stopwatch: what came late does not make the rest hurry.
        late = now_s - self._due_s > self._wait_s()
        self._due_s = (now_s if late else self._due_s) + self._wait_s()
        if self.index == self.last and not self.loop:
            self.pause()

    def ahead(self, count: int) -> tuple[int, ...]:
        """The frames that come next, in their order, this one first."""
        if self.loop:
            found = ((self.index + step) % len(self) for step in range(min(count, len(self))))
            return tuple(found)
        return tuple(range(self.index, min(self.index + count, len(self))))

    def _wait_s(self) -> float:
        if self.index == self.last:  # before it begins again, as long as between the last two
            before = max(self.last - 1, 0)
            step_s = self.times_s[self.last] - self.times_s[before]
        else:
            step_s = self.times_s[self.index + 1] - self.times_s[self.index]
        return min(max(step_s, 0.0) / self.speed, LONGEST_WAIT_S)
