"""Objects of frames, found in the background: the latest wish first."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence

from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.objects.objects import Objects

_log = logging.getLogger(__name__)

# Of so many frames objects are remembered; a frame's hold about 1 MB.
REMEMBERED = 64

FindObjects = Callable[[Frame], Objects]


class Finder:
    """Finds in one thread of its own.

    What was wanted and is no more before its turn came is not looked for; what was begun for
    another way of finding is not taken in.

    Args:
        came: told the index of each frame that was found, by the thread that finds.
    """

    def __init__(self, came: Callable[[int], None]) -> None:
        self._came = came
        self._find: FindObjects | None = None
        self._held: dict[int, Objects] = {}  # the longest unused first
        self._wanted: tuple[tuple[int, Frame], ...] = ()
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="viewer-objects", daemon=True)
        self._thread.start()

    def change(self, find: FindObjects | None) -> None:
        """Find in another way from now on, or not at all."""
        with self._changed:
            self._find, self._wanted = find, ()
            self._held.clear()

    def want(self, frames: Sequence[tuple[int, Frame]]) -> None:
        """Find in these, by their indices, in this order; forget what was wanted before."""
        with self._changed:
            self._wanted = tuple(frames)
            self._changed.notify()

    def get(self, index: int) -> Objects | None:
        """What is in a frame, if it was found."""
        with self._changed:
            objects = self._held.pop(index, None)
            if objects is not None:
                self._held[index] = objects  # used last
            return objects

    def close(self) -> None:
        """Find nothing more; what was begun is waited for."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                while (task := self._next()) is None and not self._ended:
                    self._changed.wait()
                if self._ended or task is None:
                    return
            self._do(*task)

    def _next(self) -> tuple[FindObjects, int, Frame] | None:
        find = self._find
        if find is None:
            return None
        left = ((i, frame) for i, frame in self._wanted if i not in self._held)
        return next(((find, i, frame) for i, frame in left), None)

    def _do(self, find: FindObjects, index: int, frame: Frame) -> None:
        try:
            objects = find(frame)
        except Exception as error:  # one frame must not end the search in all others
            _log.exception("objects of frame %d cannot be found", index)
            objects = Objects(fault=f"{type(error).__name__}: {error}")
        with self._changed:
            if find is not self._find:
                return
            self._held[index] = objects
            while len(self._held) > REMEMBERED:
                del self._held[next(iter(self._held))]
        self._came(index)
