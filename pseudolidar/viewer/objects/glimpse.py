"""What a run finds in a frame, as somebody sees it who looks on."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.approach import FRAMES, Approach, approach
from pseudolidar.obstacles.corridor import Ahead, Corridor
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.found import Found
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.in_order import Told
from pseudolidar.viewer.objects.objects import Objects


@dataclass(frozen=True, eq=False)
class Glimpse:
    """A frame with what was found in it.

    Args:
        found: in the frame alone.
        obstacles: the same with their tracks, and then those that should be in view.
        corridor: that is watched, if one is.
        approach: how fast the nearest thing of it comes nearer.
    """

    found: Found
    obstacles: tuple[Obstacle, ...]
    corridor: Corridor | None
    approach: Approach | None


class Glimpses:
    """Frames in their order, on their way to a page.

    Args:
        corridor: that is watched, if one is.
    """

    def __init__(self, corridor: Corridor | None) -> None:
        self._corridor = corridor
        self._ahead = deque[tuple[float, Ahead | None]](maxlen=FRAMES)

    def __call__(self, found: Found, obstacles: tuple[Obstacle, ...]) -> Glimpse:
        """The next frame.

        Args:
            found: in it.
            obstacles: as they are told: with their tracks.
        """
        nearing = None
        if found.corridor is not None:
            self._ahead.append((found.frame.timestamp_ns / NS_PER_S, found.corridor.ahead))
            nearing = approach(*zip(*self._ahead, strict=True))
        return Glimpse(found, obstacles, self._corridor, nearing)


def moment_of(glimpse: Glimpse) -> Moment:
    """What there is to see of a frame."""
    found = glimpse.found
    seen = found.seen
    moment = Moment.of(Converted(found.frame, found.cloud, seen.disparity, seen.sight.depth))
    objects = Objects.of(found, glimpse.corridor)
    return replace(moment, told=Told(glimpse.obstacles, objects, glimpse.approach))
