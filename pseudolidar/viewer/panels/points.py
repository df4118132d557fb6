"""Click on a point to know it; click on two to know how far apart they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from pseudolidar.geometry.twists import inverted
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.picking import Picked, picked
from pseudolidar.viewer.placement import moved
from pseudolidar.viewer.view import View


class Pickable(Protocol):
    """What is drawn besides the clouds of the stage."""

    def pickable(
        self, origin: Float64, direction: Float64
    ) -> Mapping[str, tuple[PointCloud, Float64]]:
        """What may lie on a line of sight of the scene, by name, as `Stage.pickable` has it."""


HINT = "*Click a point in the scene; a second one tells the distance.*"


class PointsPanel:
    """What was clicked on.

    Args:
        view: what is looked at.
        others: large clouds and meshes in it.
    """

    def __init__(self, view: View, others: Sequence[Pickable]) -> None:
        self._view, self._others = view, others
        self._last: tuple[Picked, Float64] | None = None
        self._listeners: list[Callable[[Float64], None]] = []
        self._text = view.gui.add_markdown(HINT)
        view.server.viser.scene.on_click()(self._clicked)
        view.on_shown(self._forget)

    def _forget(self, _moment: Moment) -> None:
        self._last = None

    def _clicked(self, event: Any) -> None:
        self.click(np.array(event.ray_origin), np.array(event.ray_direction))

    def click(self, origin: Float64, direction: Float64) -> None:
        """Tell the point on a line of sight (3,), (3,) of the scene."""
        stage = self._view.stage
        # Of the scene as it is now: it may take seconds to find the point, while frames go on.
        T_local_scene = inverted(stage.placement.T_scene_local)
        clouds = dict(stage.pickable())
        for drawn in self._others:
            clouds |= drawn.pickable(origin, direction)
        found = picked(clouds, origin, direction)
        if found is None:
            self._text.content = "nothing there"
            return
        _, T = clouds[found.cloud]
        place = moved(T, found.xyz_m)
        self._view.marks.show_place(place)
        lines = [f"**{escaped(found.cloud)}** {found.text}"]
        last = self._last  # a frame that is drawn meanwhile makes it None
        if last is not None:
            before, there = last
            apart_m = float(np.linalg.norm(place - there))
            lines += [f"before: {before.text}", f"**{apart_m:.3f} m** apart"]
        self._last = found, place
        self._text.content = "\n\n".join(lines)
        for listener in self._listeners:
            listener(moved(T_local_scene, place))

    def on_picked(self, listener: Callable[[Float64], None]) -> None:
        """Call this with the place of every point that is clicked on.

        It is (3,) m in the map, relative to the origin of the scene.
        """
        self._listeners.append(listener)
