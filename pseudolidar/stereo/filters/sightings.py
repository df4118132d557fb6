"""Matched frames of a sequence, kept for the frames that follow; results never depend on it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Protocol

from pseudolidar.errors import PseudolidarError
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

# Matched frames that are kept beyond the window: workers are some frames apart.
SPARE = 8


class PairSequence(Protocol):
    """Where the frames come from."""

    def load(self, index: int) -> StereoFrame:
        """Frame `index`; pure."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """What stays of a matched frame.

    Args:
        disparity: of its left image.
        rig: its rig.
        pose: `T_map_base_link`, where its source knows it.
    """

    disparity: DisparityMap
    rig: StereoRig
    pose: Pose | None


@dataclass(frozen=True)
class Sightings:
    """A matcher that remembers: picklable, safe to call from several threads at once.

    A frame is matched once, whoever asks first; what was dropped or never asked for is loaded and
    matched again, with the same result. So memory is bounded, and no result depends on which
    frames were worked on before, or on how many threads do it.

    Args:
        matcher: pair to disparity; pure.
        source: where other frames of the sequence are loaded from, by `StereoFrame.index`.
        window: frames that are asked for together.
    """

    matcher: StereoMatcher
    source: PairSequence
    window: int
    _memo: _Memo = field(default_factory=lambda: _Memo(), repr=False, compare=False)

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image of `frame`."""
        seen = self._memo.get(frame.index, lambda: self._seen(frame), self.window + SPARE)
        return seen.disparity

    def of(self, index: int) -> Sighting | None:
        """What frame `index` of the source saw; None where there is no usable frame."""
        if index < 0:
            return None
        try:
            return self._memo.get(
                index, lambda: self._seen(self.source.load(index)), self.window + SPARE
            )
        except PseudolidarError:
            return None  # the frame is named when its own turn comes

    def _seen(self, frame: StereoFrame) -> Sighting:
        return Sighting(self.matcher(frame), frame.rig, frame.pose)


class _Memo:
    """The last sightings by index; each is made by one thread while others wait for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: OrderedDict[int, Future[Sighting]] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return _Memo, ()  # another process begins with nothing

    def get(self, index: int, make: Any, capacity: int) -> Sighting:
        with self._lock:
            future = self._known.get(index)
            mine = future is None
            if future is None:
                future = self._known[index] = Future()
                while len(self._known) > capacity:
                    self._known.popitem(last=False)
            self._known.move_to_end(index)
        if not mine:
            return future.result()
        try:
            seen: Sighting = make()
        except BaseException as error:
            with self._lock:
                self._known.pop(index, None)
            future.set_exception(error)
            raise
        future.set_result(seen)
        return seen
