"""The way of the rig: where it was, and where it will be as far as that is known."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.geometry.twists import inverted
from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.lines import coloured
from pseudolidar.viewer.stage import MAP
from pseudolidar.viewer.stills import PATH_COLOUR

if TYPE_CHECKING:
    from pseudolidar.viewer.view import View

_log = logging.getLogger(__name__)

# Places of a path; of more, every second one is left out.
MOST_PLACES = 4000
# Of the part that the rig has not come to.
COMING_COLOUR = (235, 200, 60)
WIDTH_PX = 3.0


class DrawnPath:
    """A line through the places of the frames, in their order.

    Those of all frames where a source tells them without its pictures; else of the frames that were
    shown.

    Args:
        view: what is looked at.
        poses: (N, 4, 4) `T_map_base_link` of all frames, NaN of those that nobody knows; None where
            frames must be loaded to know. Called in a thread of its own.
    """

    def __init__(self, view: View, poses: Callable[[], Float64 | None] | None = None) -> None:
        self._view = view
        self._places: dict[int, Float32] = {}
        self._line: Any = None
        self._drawn: tuple[tuple[int, ...], int] | None = None
        self._visible = True
        self._poses: Float64 | None = None
        self._whole = False
        self._told = threading.Thread(target=self._tell, args=(poses,), daemon=True)
        self._told.start()
        view.on_shown(self._show)

    @property
    def there(self) -> bool:
        """Whether there is anything to be seen of it."""
        return self._line is not None

    def show(self, shown: bool) -> None:
        """Draw it, or not."""
        self._visible = shown
        if self._line is not None:
            self._line.visible = shown

    def wait(self) -> None:
        """Until the poses of all frames are known, for who shows every frame once."""
        self._told.join()

    def _tell(self, poses: Callable[[], Float64 | None] | None) -> None:
        try:
            self._poses = None if poses is None else poses()
        except PseudolidarError as error:
            _log.warning("the way of the rig cannot be told: %s", error)
        self._view.redraw()

    def _show(self, moment: Moment) -> None:
        self._add(moment)
        indices = sorted(self._places)
        passed = sum(index <= moment.index for index in indices)
        self._draw(tuple(indices), max(passed - 1, 0))

    def _add(self, moment: Moment) -> None:
        """The places that this frame tells: its own, or with it those of all."""
        T, places = moment.T_map_forward, dict[int, Float64]()
        if T is None or self._whole:
            return
        if self._poses is not None:
            places = places_of(self._poses, moment.index, T)
            self._whole = bool(places)
        places[moment.index] = T[:3, 3]
        origin_m = self._view.stage.placement.origin_m
        self._places |= {at: (xyz - origin_m).astype(np.float32) for at, xyz in places.items()}
        while len(self._places) > MOST_PLACES:
            self._places = {at: self._places[at] for at in sorted(self._places)[::2]}

    def _draw(self, indices: tuple[int, ...], passed: int) -> None:
        """The line, so many of its parts passed; what has not changed is not sent."""
        if len(indices) < 2 or (indices, passed) == self._drawn:
            return
        before, self._drawn = self._drawn, (indices, passed)
        colours = colours_of(len(indices) - 1, passed)
        if before is None or before[0] != indices:
            segments = segments_of(self._places)
            if self._line is None:
                self._line = self._view.server.viser.scene.add_line_segments(
                    f"{MAP}/way", segments, colours, thickness=WIDTH_PX, thickness_units="screen",
                    visible=self._visible,
                )  # fmt: skip
            self._line.points = segments
        self._line.colors = colours


def places_of(poses: Float64, index: int, T_map_forward: Float64) -> dict[int, Float64]:
    """(3,) places of the frame of the clouds, by frame, from the one of one frame.

    Args:
        poses: (N, 4, 4) `T_map_base_link`, NaN of frames that nobody knows.
        index: of the frame that is known.
        T_map_forward: (4, 4) where the frame of its clouds is.
    """
    known = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
    if index not in known:
        return {}
    T_base_forward = inverted(poses[index]) @ T_map_forward
    every = poses[known] @ T_base_forward
    return {int(at): T[:3, 3] for at, T in zip(known, every, strict=True)}


def segments_of(places: dict[int, Float32]) -> Float32:
    """(N, 2, 3) from place to place in the order of the frames' numbers."""
    ordered = np.array([places[index] for index in sorted(places)], np.float32).reshape(-1, 3)
    return np.stack([ordered[:-1], ordered[1:]], axis=1)


def colours_of(parts: int, passed: int) -> UInt8:
    """(N, 2, 3) of a line of so many parts, the first ones passed."""
    return np.concatenate(
        [coloured([PATH_COLOUR], passed), coloured([COMING_COLOUR], parts - passed)]
    )
