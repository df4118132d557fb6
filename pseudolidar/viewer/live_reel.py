"""The newest frame of a run that goes on, in place of a sequence."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from pseudolidar.viewer.moment import Moment


class LiveReel:
    """One frame that becomes another as the run goes on; a `Reel`.

    Args:
        name: what the run goes through, in one line.
        frames: how many that are; None where nobody knows.
        finds: whether the run finds objects, which come with its frames.

    `made` counts the frames that the run has made, `passed_over` those of them that gave way to
    newer ones; `finished` says that there will be no more.
    """

    def __init__(self, name: str, frames: int | None = None, *, finds: bool = False) -> None:
        self.name, self.frames, self.finds = name, frames, finds
        self.ids: Sequence[str] = ("",)
        self.times_s: Sequence[float] = (0.0,)
        self.held = self.finished = False
        self.made = self.passed_over = 0
        self._lock = threading.Lock()
        self._newest = self._shown = Moment("", 0)

    def take(self, moment: Moment) -> bool:
        """Have a frame shown from now on.

        Returns:
            Whether it is: not while the one before is held.
        """
        with self._lock:
            self._newest = moment
            if not self.held:
                self._shown = moment
            return not self.held

    def hold(self, *, held: bool) -> None:
        """Stay at the shown frame, or go on with the newest."""
        with self._lock:
            self.held = held
            if not held:
                self._shown = self._newest

    def load(self, _index: int) -> Moment:
        """The frame to show, whatever its number."""
        return self._shown
