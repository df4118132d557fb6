"""Objects of the shown frame, whoever finds them: a run that did, or a detector now."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.detector import Detector
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import LEFT_FRAME
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.finder import Finder
from pseudolidar.viewer.objects.in_order import InOrder, Told
from pseudolidar.viewer.objects.objects import Find, Objects
from pseudolidar.viewer.objects.scene import (
    ObjectScene,
    shown_corridor,
    shown_objects,
    shown_points,
    shown_truths,
)
from pseudolidar.viewer.objects.shown import Band

RunObjects = Mapping[str, tuple[Obstacle, ...]]


@dataclass(frozen=True)
class Wish:
    """What somebody wants to know of frames.

    Args:
        of_run: what a run found.
        detect: who finds now; None for nobody.
        corridor: what is watched; None for none.
        tracker: follows what is found now; None for none.
    """

    of_run: bool = False
    detect: Detector | None = None
    corridor: Corridor | None = None
    tracker: Tracker | None = None

    @property
    def of_things(self) -> tuple[bool, Detector | None, Tracker | None]:
        """Who says which thing is which: others mean others by the same number."""
        return self.of_run, self.detect, self.tracker

    @property
    def searching(self) -> bool:
        """Whether pictures are looked into."""
        return self.detect is not None or self.corridor is not None


class ObjectWatch:
    """Knows the objects of frames, as far as they are found; callable from any thread.

    Args:
        sighted: a frame to what is seen in it; None where nothing can be measured.
        run: what a run found, by frame.
        came: told the index of each frame that objects are found in.
    """

    def __init__(
        self,
        sighted: Callable[[Frame], Seen] | None,
        run: RunObjects,
        came: Callable[[int], None],
    ) -> None:
        self._sighted, self._run = sighted, run
        self._finder = Finder(came)
        self._lock = threading.Lock()
        self._wish = Wish()
        self._in_order = InOrder(None)
        self.band = Band()
        self.chosen = ""

    def ask(self, wish: Wish) -> None:
        """Want something else from now on; of other detectors and trackers nothing is chosen."""
        with self._lock:
            before, self._wish = self._wish, wish
            if wish.of_things != before.of_things:
                self._in_order = InOrder(None if wish.of_run else wish.tracker)
                self.chosen = ""
            if (wish.detect, wish.corridor) != (before.detect, before.corridor):
                self._search()

    def again(self) -> None:
        """Want the same anew: frames are seen otherwise now."""
        with self._lock:
            self._search()

    def _search(self) -> None:
        """Find what is wanted from now on; called with the lock held, so that the last one is it.

        The finder holds no lock of its own while it calls others.
        """
        wish, find = self._wish, None
        if wish.searching and self._sighted is not None:
            find = Find(self._sighted, wish.detect, wish.corridor)
        self._finder.change(find)

    def want(self, moments: Sequence[Moment]) -> None:
        """Find in these, the first one first."""
        if self._wish.searching:
            frames = ((moment.index, _frame(moment)) for moment in moments)
            self._finder.want([(index, frame) for index, frame in frames if frame is not None])

    def ready(self, moment: Moment) -> bool:
        """Whether all that is wanted of a frame is found."""
        if not self._wish.searching or self._sighted is None or _frame(moment) is None:
            return True
        if self._finder.get(moment.index) is not None:
            return True
        self.want([moment])
        return False

    def scene(self, moment: Moment) -> ObjectScene:
        """What is drawn of a frame: of what is not found yet, nothing."""
        T = T_forward_camera(moment)
        if T is None:
            return ObjectScene(text=self._without_place(moment))
        sight = moment.sight
        truths = () if sight is None else shown_truths(moment, sight)
        found = self._finder.get(moment.index) if self._wish.searching else None
        told = self._told(moment, found)
        shown = shown_objects(told, self.band, T)
        xyz, colours = shown_points(told, self.band, T)
        corridor = None
        if told.objects.corridor is not None:
            corridor = shown_corridor(told.objects.corridor, told.approach, T)
        text = self._text(moment, found, shown=len(shown), every=len(told.obstacles))
        return ObjectScene(shown, truths, corridor, xyz, colours, self.chosen, text)

    def close(self) -> None:
        """Find nothing more."""
        self._finder.close()

    def _told(self, moment: Moment, found: Objects | None) -> Told:
        """Objects with their tracks, by whoever is asked for them."""
        with self._lock:
            objects = found or Objects()
            told = Told(objects.obstacles, objects)
            if found is not None and moment.sight is not None:
                camera = moment.sight.camera
                told = self._in_order(moment.index, moment.timestamp_ns, objects, camera)
        if not self._wish.of_run:
            return told
        if moment.told is not None:
            return moment.told
        return replace(told, obstacles=self._run.get(moment.id, ()), round=0)

    def _text(self, moment: Moment, found: Objects | None, *, shown: int, every: int) -> str:
        if self._wish.searching and _frame(moment) is None:
            return "Frames without pictures: nothing can be found in them."
        if self._wish.searching and self._sighted is None:
            return "Nothing can be measured in these frames."
        if self._wish.searching and found is None:
            return "looking ..."
        if found is not None and found.fault:
            return found.fault
        if self._wish.detect is None and not self._wish.of_run:
            return ""
        hidden = f", {every - shown} more beyond the limits above" if every > shown else ""
        return f"{shown} object{'' if shown == 1 else 's'}{hidden}"

    def _without_place(self, moment: Moment) -> str:
        asked = self._wish.searching or self._wish.of_run
        if moment.fault or not moment.clouds or not asked:
            return ""
        return "Nobody knows where these clouds are seen from: objects cannot be drawn in them."


def T_forward_camera(moment: Moment) -> Float64 | None:
    """(4, 4) left camera into the frame of the clouds; None where nobody knows."""
    if moment.sight is not None:
        return moment.sight.T_forward_camera
    frame = None if moment.converted is None else moment.converted.frame
    if isinstance(frame, RecordedCloud) and frame.cloud.frame == LEFT_FRAME:
        T = np.eye(4)
        T[:3, :3] = R_BODY_OPTICAL
        return T
    return None


def _frame(moment: Moment) -> Frame | None:
    """A frame that has pictures; None where there are only clouds, or nothing."""
    frame = None if moment.converted is None else moment.converted.frame
    return frame if isinstance(frame, StereoFrame | DepthFrame) else None
