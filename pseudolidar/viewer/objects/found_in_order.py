"""What a run finds, frame after frame, as somebody sees it who looks on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.approach import Approach, Nearing
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.corridor_table import Watched
from pseudolidar.running.products.found import Found
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.in_order import Told
from pseudolidar.viewer.objects.objects import Objects


@dataclass(frozen=True, eq=False)
class FoundInOrder:
    """What was found in a frame, with what is known from the frames before.

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


class FindsInOrder:
    """Frames in their order, on their way to a page.

    Args:
        corridor: that is watched, if one is.
        ids: of all frames of the source, in their order.
        earlier: the corridor in those that an earlier run has done, and that are not done again.
    """

    def __init__(
        self, corridor: Corridor | None, ids: Sequence[str], earlier: Iterable[Watched]
    ) -> None:
        self._corridor = corridor
        self._left = iter(ids)
        self._earlier = {one.frame: one for one in earlier}
        self._nearing = Nearing()

    def __call__(self, found: Found, obstacles: tuple[Obstacle, ...]) -> FoundInOrder:
        """The next frame that was done, after all before it that were done earlier.

        Args:
            found: in it.
            obstacles: as they are told: with their tracks.
        """
        frame, approach = found.frame, None
        for name in iter(self._left.__next__, frame.id):
            before = self._earlier.get(name)
            if before is not None and before.time_s is not None and before.view is not None:
                self._nearing(before.time_s, before.ahead)
        if found.corridor is not None:
            approach = self._nearing(frame.timestamp_ns / NS_PER_S, found.corridor.ahead)
        return FoundInOrder(found, obstacles, self._corridor, approach)


def moment_of(frame: FoundInOrder) -> Moment:
    """What there is to see of a frame."""
    found = frame.found
    seen = found.seen
    moment = Moment.of(Converted(found.frame, found.cloud, seen.disparity, seen.sight.depth))
    objects = Objects.of(found, frame.corridor)
    return replace(moment, told=Told(frame.obstacles, objects, frame.approach))
