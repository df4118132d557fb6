"""The way of the rig as far as it was shown, growing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.structures.arrays import Float32
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.stage import MAP, PATH_COLOUR

if TYPE_CHECKING:
    from pseudolidar.viewer.view import View

# Places of a path; of more, every second one is left out.
MOST_PLACES = 4000


class DrawnPath:
    """A line through the places of the shown frames, in the order of the frames.

    Args:
        view: what is looked at.
    """

    def __init__(self, view: View) -> None:
        self._view = view
        self._places: dict[int, Float32] = {}
        self._line: Any = None
        view.on_shown(self._show)

    def _show(self, moment: Moment) -> None:
        if moment.T_map_forward is None or moment.index in self._places:
            return
        placed = self._view.stage.placement.local(moment.T_map_forward)
        self._places[moment.index] = placed[:3, 3].astype(np.float32)
        if len(self._places) > MOST_PLACES:
            self._places = dict(list(self._places.items())[::2])
        segments = segments_of(self._places)
        if not len(segments):
            return
        if self._line is None:
            self._line = self._view.server.viser.scene.add_line_segments(
                f"{MAP}/way", segments, PATH_COLOUR, thickness=3.0, thickness_units="screen"
            )
            return
        self._line.points = segments


def segments_of(places: dict[int, Float32]) -> Float32:
    """(N, 2, 3) from place to place in the order of the frames' numbers."""
    ordered = np.array([places[index] for index in sorted(places)], np.float32).reshape(-1, 3)
    return np.stack([ordered[:-1], ordered[1:]], axis=1)
