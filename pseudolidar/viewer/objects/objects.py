"""What was found in one frame: as much of it as is drawn and told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.corridor_view import CorridorView
from pseudolidar.obstacles.detector import Detector
from pseudolidar.running.finding import found_in
from pseudolidar.running.products.found import Found
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.arrays import Float32, Float64, Int64
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame


@dataclass(frozen=True, eq=False)
class WatchedCorridor:
    """A corridor as it was seen in a frame.

    Args:
        view: the nearest thing in it.
        corners_m: (8, 3) of it, in `camera_left`.
    """

    view: CorridorView
    corners_m: Float64


@dataclass(frozen=True, eq=False)
class Objects:
    """What was found in a frame.

    Args:
        obstacles: in `camera_left`, the nearest first.
        T_map_camera: pose of the left camera, where it is known.
        corridor: where one is watched.
        xyz: (N, 3) points of obstacles, in `camera_left`.
        numbers: (N,) which obstacle each is of, from 0.
        fault: why nothing could be found.
    """

    obstacles: tuple[Obstacle, ...] = ()
    T_map_camera: Pose | None = None
    corridor: WatchedCorridor | None = None
    xyz: Float32 = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    numbers: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    fault: str = ""

    @classmethod
    def of(cls, found: Found, corridor: Corridor | None) -> Self:
        """The part of a find that is drawn."""
        pixels = [obstacle.pixels for obstacle in found.obstacles]
        counts = [len(each) for each in pixels]
        flat = np.concatenate([np.zeros(0, np.int64), *pixels])
        watched = None
        if corridor is not None and found.corridor is not None:
            watched = WatchedCorridor(found.corridor, corridor.corners_m(found.seen.sight))
        return cls(
            found.obstacles,
            found.seen.T_map_camera,
            watched,
            np.asarray(found.seen.cloud.xyz[flat], np.float32),
            np.repeat(np.arange(len(counts)), counts),
        )


@dataclass(frozen=True)
class Find:
    """A frame to what is in it, as `pseudolidar obstacles` does.

    Args:
        sighted: a frame to what is seen in it.
        detect: says where objects are; None where nothing is asked.
        corridor: what is watched, if anything.
    """

    sighted: Callable[[Frame], Seen]
    detect: Detector | None = None
    corridor: Corridor | None = None

    def __call__(self, frame: Frame) -> Objects:
        """Find and measure; what hinders that is told in the answer."""
        try:
            found = found_in(frame, self.sighted(frame), self.detect, self.corridor)
        except PseudolidarError as error:
            return Objects(fault=str(error))
        return Objects.of(found, self.corridor)
