"""Who is who and how fast, as far as frames are shown in their order."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.approach import Approach, Nearing
from pseudolidar.obstacles.coasting import LastSeen
from pseudolidar.obstacles.tracker import Following, Tracker
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.viewer.objects.objects import Objects

NO_OBJECTS = Objects()
# Frames farther apart do not follow one another, s.
LONGEST_STEP_S = 2.0


@dataclass(frozen=True, eq=False)
class Told:
    """Objects with what is known from the frames before.

    Args:
        obstacles: with their tracks where they are followed, and those that should be in view.
        objects: what was found in the frame alone: its first obstacles, in their order.
        approach: how fast the nearest thing of the corridor comes nearer.
        round: how often it was begun anew, for numbers of tracks begin anew with it.
    """

    obstacles: tuple[Obstacle, ...]
    objects: Objects = NO_OBJECTS
    approach: Approach | None = None
    round: int = 0


class InOrder:
    """Follows objects while frames are shown one after the other; after any jump anew.

    Args:
        tracker: follows obstacles; None for none.
    """

    def __init__(self, tracker: Tracker | None) -> None:
        self._tracker = tracker
        self._last: tuple[int, int, Objects, Told] | None = None
        self._round = 0
        self._begin()

    def __call__(self, index: int, time_ns: int, objects: Objects, camera: Camera) -> Told:
        """Objects of a frame with their tracks; the same again where it is asked again.

        Args:
            index: of the frame.
            time_ns: of the frame.
            objects: that were found in it.
            camera: of the frame.
        """
        last = self._last
        if last is not None and last[0] == index and last[2] is objects:
            return last[3]
        if last is None or not (index > last[0] and self._follows(last[1], time_ns)):
            self._begin()
        followed = self._followed(objects, time_ns, camera)
        told = Told(followed, objects, self._approach(objects, time_ns), self._round)
        self._last = index, time_ns, objects, told
        return told

    def _begin(self) -> None:
        self._round += 1
        self._follow: Following | None = None if self._tracker is None else self._tracker.load()
        self._seen = LastSeen()
        self._nearing = Nearing()

    @staticmethod
    def _follows(before_ns: int, now_ns: int) -> bool:
        return 0 < now_ns - before_ns <= LONGEST_STEP_S * NS_PER_S

    def _followed(self, objects: Objects, time_ns: int, camera: Camera) -> tuple[Obstacle, ...]:
        if self._follow is None:
            return objects.obstacles
        try:
            followed = self._follow(objects.obstacles, time_ns, objects.T_map_camera)
        except PseudolidarError:  # poses that begin or end midway are of another sequence
            self._begin()
            return objects.obstacles
        return (*followed.obstacles, *self._seen(followed, camera))

    def _approach(self, objects: Objects, time_ns: int) -> Approach | None:
        if objects.corridor is None:
            self._nearing = Nearing()
            return None
        return self._nearing(time_ns / NS_PER_S, objects.corridor.view.ahead)
