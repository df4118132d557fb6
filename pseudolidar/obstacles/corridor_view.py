"""What is seen of a corridor: something in it, nothing, or too little to tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.obstacles.corridor import Ahead, Corridor, nearest_ahead
from pseudolidar.obstacles.level import level_axes, turned
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Float64

State = Literal["thing", "free", "unseen"]
# A corridor in which nothing is found is free where so much of it is seen.
LEAST_SEEN = 0.5
# Of the lines of sight every second one of every second row is looked at.
EVERY_PX = 2
# In place of a direction across or upwards of 0.
LEVEL = 1e-9


@dataclass(frozen=True)
class CorridorView:
    """What is seen of a corridor in one frame.

    Args:
        ahead: the nearest thing in it, None where nothing is seen.
        seen: share of it, as far as it is in the picture, whose lines of sight have a depth, 0-1.
    """

    ahead: Ahead | None
    seen: float

    @property
    def state(self) -> State:
        """Whether something is in it, or nothing, or nobody can tell."""
        if self.ahead is not None:
            return "thing"
        return "free" if self.seen >= LEAST_SEEN else "unseen"


def corridor_view(sight: Sight, corridor: Corridor) -> CorridorView:
    """The nearest thing in the corridor, and how much of the corridor is seen."""
    return CorridorView(nearest_ahead(sight, corridor), share_seen(sight, corridor))


def share_seen(sight: Sight, corridor: Corridor) -> float:
    """Share of a corridor whose lines of sight have a depth; 0 where none leads through it.

    Each pixel counts as much as its line of sight holds of the corridor's volume, from where the
    search for disparities begins on: few pixels show most of it, as they look along it.
    """
    held = _volumes(sight, corridor)
    known = sight.depth.valid[::EVERY_PX, ::EVERY_PX].ravel()
    total = float(held.sum())
    return float(held[known].sum()) / total if total > 0 else 0.0


def _volumes(sight: Sight, corridor: Corridor) -> Float64:
    """(N,) volume of the corridor that each line of sight holds, in any unit.

    A pixel is z^2 / (fx fy) square metres at depth z, so that of a stretch grows as z^3.
    """
    height, width = sight.depth.values.shape
    K = sight.camera.K
    v, u = np.mgrid[0:height:EVERY_PX, 0:width:EVERY_PX]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=2)
    x, y, z = turned(level_axes(sight), rays.reshape(-1, 3)).T  # of a depth of 1 m
    eye_m, low_m, high_m = corridor.heights_m(sight)
    y = np.where(np.abs(y) < LEVEL, LEVEL, y)
    sides = (eye_m - low_m) / y, (eye_m - high_m) / y
    first = np.maximum(np.minimum(*sides), sight.nearest_m)
    last = np.minimum(np.maximum(*sides), 0.5 * corridor.width_m / np.maximum(np.abs(x), LEVEL))
    last = np.minimum(last, corridor.length_m / np.maximum(z, LEVEL))
    ahead = (z > LEVEL) & (last > np.maximum(first, 0.0))
    return np.asarray(np.where(ahead, last**3 - np.maximum(first, 0.0) ** 3, 0.0))
