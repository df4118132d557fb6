"""Frames made ready in the background, ahead of the one that is shown, within a memory budget."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from pseudolidar.viewer.moment import Moment

_log = logging.getLogger(__name__)
# What frames that are ready may hold, bytes, and how many are made ready ahead of the shown one.
BUDGET_BYTES, AHEAD = 1 << 30, 12
# What is said of a frame that cannot be made, for no reason that is known.
ODD = "it cannot be shown: see the terminal"


class Ready:
    """Frames by their index, the wanted ones first.

    `want` says which frames are wanted, the most wanted first: these are made and kept; others are
    given up when the memory is needed, the longest unused first. What was wanted and is no more
    before its turn came is not made.

    Args:
        load: makes a frame; called from threads.
        workers: threads.
        budget_bytes: what frames may hold. The most wanted one is kept whatever it holds.
    """

    def __init__(
        self,
        load: Callable[[int], Moment],
        *,
        workers: int = 2,
        budget_bytes: int = BUDGET_BYTES,
    ) -> None:
        self._load, self._budget_bytes = load, budget_bytes
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="viewer-frames")
        self._lock = threading.Lock()
        self._held: dict[int, Moment] = {}  # the longest unused first
        self._coming: dict[int, Future[None]] = {}
        self._wanted: Sequence[int] = ()
        # What threads began to make for another one is of an old kind, and is not taken in.
        self._made_for = object()

    def want(self, indices: Sequence[int]) -> None:
        """Make these ready, in this order, and forget what was wanted before."""
        with self._lock:
            self._wanted = tuple(indices)
            keep = set(indices)
            for index in [i for i, future in self._coming.items() if i not in keep]:
                if self._coming[index].cancel():
                    del self._coming[index]
            room = self._budget_bytes - sum(moment.nbytes for moment in self._kept(keep))
            for index in indices:
                if index not in self._held and index not in self._coming and room > 0:
                    self._coming[index] = self._pool.submit(self._make, index)
                    room -= self._usual_bytes()

    def get(self, index: int) -> Moment | None:
        """A frame, if it is ready."""
        with self._lock:
            moment = self._held.pop(index, None)
            if moment is not None:
                self._held[index] = moment  # used last
            return moment

    def put(self, index: int, moment: Moment) -> None:
        """Take in a frame that was made elsewhere, in place of any."""
        with self._lock:
            self._held.pop(index, None)
            self._held[index] = moment
            self._give_up()

    def forget(self) -> None:
        """Drop everything: frames are made otherwise from now on."""
        with self._lock:
            for future in self._coming.values():
                future.cancel()
            self._coming.clear()
            self._held.clear()
            self._made_for = object()

    def close(self) -> None:
        """Make nothing more."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    @property
    def nbytes(self) -> int:
        """What the frames hold."""
        with self._lock:
            return sum(moment.nbytes for moment in self._held.values())

    def _make(self, index: int) -> None:
        made_for = self._made_for
        try:
            moment = self._load(index)
        except Exception:  # a frame that is odd in a new way must not be waited for
            _log.exception("frame %d cannot be made", index)
            moment = Moment("", index, fault=ODD)
        with self._lock:
            if made_for is not self._made_for:
                return
            self._coming.pop(index, None)
            self._held[index] = moment
            self._give_up()

    def _give_up(self) -> None:
        keep = set(self._wanted)
        held = sum(moment.nbytes for moment in self._held.values())
        unwanted = [index for index in self._held if index not in keep]
        least_wanted = [index for index in reversed(self._wanted[1:]) if index in self._held]
        for index in (*unwanted, *least_wanted):
            if held <= self._budget_bytes:
                return
            held -= self._held.pop(index).nbytes

    def _kept(self, keep: set[int]) -> list[Moment]:
        return [moment for index, moment in self._held.items() if index in keep]

    def _usual_bytes(self) -> int:
        sizes = [moment.nbytes for moment in self._held.values()]
        return sum(sizes) // len(sizes) if sizes else 1
