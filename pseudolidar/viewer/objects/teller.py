"""What is told and drawn of frames, whoever finds the objects in them: a run, or a detector now.

Who is who is known where frames come in their order; what is found in each is handed in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Self

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

    def in_order(self) -> InOrder:
        """Who follows what is found, from the next frame on; a run has done it already."""
        return InOrder(None if self.of_run else self.tracker)


@dataclass(frozen=True, eq=False)
class Teller:
    """Tells frames in their order; calls must not overlap.

    Args:
        wish: what is wanted.
        run: what a run found, by frame.
        measurable: whether things in frames can be measured.
        in_order: knows who is who.
    """

    wish: Wish
    run: RunObjects
    measurable: bool
    in_order: InOrder

    def scene(
        self, moment: Moment, found: Objects | None, band: Band, chosen: str = ""
    ) -> ObjectScene:
        """What is drawn of a frame.

        Args:
            moment: the frame.
            found: in it, now; None of what is not found yet.
            band: what of it is shown.
            chosen: key of the object that somebody chose.
        """
        T = T_forward_camera(moment)
        if T is None:
            hindrance = self._without_place(moment)
            return ObjectScene(text=hindrance, hindered=bool(hindrance))
        sight = moment.sight
        truths = () if sight is None else shown_truths(moment, sight)
        told = self._told(moment, found)
        shown = shown_objects(told, band, T)
        xyz, colours = shown_points(told, band, T)
        corridor = None
        if told.objects.corridor is not None:
            corridor = shown_corridor(told.objects.corridor, told.approach, T)
        hindrance = self._hindrance(moment, found)
        text = hindrance or self._count(found, shown=len(shown), every=len(told.obstacles))
        hindered = bool(hindrance)
        return ObjectScene(shown, truths, corridor, xyz, colours, chosen, text, hindered)

    def _told(self, moment: Moment, found: Objects | None) -> Told:
        """Objects with their tracks, by whoever is asked for them."""
        objects = found or Objects()
        told = Told(objects.obstacles, objects)
        if found is not None and moment.sight is not None:
            camera = moment.sight.camera
            told = self.in_order(moment.index, moment.timestamp_ns, objects, camera)
        if not self.wish.of_run:
            return told
        if moment.told is not None:
            return moment.told
        return replace(told, obstacles=self.run.get(moment.id, ()), round=0)

    def _hindrance(self, moment: Moment, found: Objects | None) -> str:
        """Why nothing can be found in a frame; "" where something could be."""
        if self.wish.searching and pictured(moment) is None:
            return "Frames without pictures: nothing can be found in them."
        if self.wish.searching and not self.measurable:
            return "Nothing can be measured in these frames."
        return "" if found is None else found.fault

    def _count(self, found: Objects | None, *, shown: int, every: int) -> str:
        if self.wish.searching and found is None:
            return "looking ..."
        if self.wish.detect is None and not self.wish.of_run:
            return ""
        hidden = f", {every - shown} more beyond the limits above" if every > shown else ""
        return f"{shown} object{'' if shown == 1 else 's'}{hidden}"

    def _without_place(self, moment: Moment) -> str:
        asked = self.wish.searching or self.wish.of_run
        if moment.fault or not moment.clouds or not asked:
            return ""
        return "Nobody knows where these clouds are seen from: objects cannot be drawn in them."


@dataclass(frozen=True, eq=False)
class ScenesAtOnce:
    """Frames in their order to what is drawn of them: what is to be found is found at once.

    Args:
        teller: with nothing told yet.
        find: a frame to what is in it; None where nothing is looked for.
        band: what of it is shown.
    """

    teller: Teller
    find: Find | None
    band: Band = Band()

    @classmethod
    def of(cls, wish: Wish, run: RunObjects, sighted: Callable[[Frame], Seen] | None) -> Self:
        """What is wanted of frames.

        Args:
            wish: what that is.
            run: what a run found, by frame.
            sighted: a frame to what is seen in it; None where nothing can be measured.
        """
        find = None
        if wish.searching and sighted is not None:
            find = Find(sighted, wish.detect, wish.corridor)
        return cls(Teller(wish, run, sighted is not None, wish.in_order()), find)

    def __call__(self, moment: Moment) -> ObjectScene:
        """What is drawn of the next frame."""
        frame = pictured(moment)
        found = None if self.find is None or frame is None else self.find(frame)
        return self.teller.scene(moment, found, self.band)


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


def pictured(moment: Moment) -> Frame | None:
    """A frame that has pictures; None where there are only clouds, or nothing."""
    frame = None if moment.converted is None else moment.converted.frame
    return frame if isinstance(frame, StereoFrame | DepthFrame) else None
