"""A box of points: how many, how large, how flat."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.boxes.figures import BoxFigures
from pseudolidar.viewer.boxes.gathered import Gatherer
from pseudolidar.viewer.boxes.region import LEAST_M, MOST_M, Region
from pseudolidar.viewer.boxes.told import table
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.drawn_region import DrawnRegion
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.panels.points import PointsPanel
from pseudolidar.viewer.view import View

HINT = (
    "Click a point in the scene, then `Box here`; or click two corners, then `Box between`. "
    "Drag the handles to move and turn it."
)
FIRST_M = (2.0, 2.0, 2.0)
# Angles that the page shows are rounded to this, degrees.
TURN_STEP = 0.1
# Sizes that differ by less are the same to the page, which rounds them, m.
SAME_SIZE_M = 1e-3


class BoxPanel:
    """A box that somebody sets, and what lies in it, told anew with each frame.

    Args:
        view: what is looked at.
        points: is clicked on.
        gatherer: finds what lies in it.
    """

    def __init__(self, view: View, points: PointsPanel, gatherer: Gatherer) -> None:
        self._view, self._gatherer = view, gatherer
        self._lock = threading.RLock()
        self._region: Region | None = None
        self._asked: Region | None = None
        self._clicked: deque[Float64] = deque(maxlen=2)
        self._listeners: list[Callable[[], None]] = []
        self.figures: Mapping[str, BoxFigures] = {}
        gui = view.gui
        gui.add_markdown(HINT)
        here = gui.add_button("Box here", disabled=True)
        between = gui.add_button("Box between", disabled=True)
        self._buttons = here, between
        self._text = gui.add_html("")
        self._size = gui.add_vector3(
            "Size, m", FIRST_M, min=(LEAST_M,) * 3, max=(MOST_M,) * 3, step=0.1
        )
        self._turn = gui.add_number("Turn, °", 0.0, min=-180.0, max=180.0, step=TURN_STEP)
        flush = gui.add_button("Turn it to the plane", disabled=True)
        self._flush = flush
        self._shown = gui.add_checkbox("Shown", initial_value=True)
        self._handles = gui.add_checkbox("Handles", initial_value=True)
        self._drawn = DrawnRegion(view.server.viser.scene, self._dragged)
        self._work = Latest(self._tell, name="box")
        here.on_click(lambda _: self._here())
        between.on_click(lambda _: self._between())
        flush.on_click(lambda _: self._to_plane())
        self._size.on_update(lambda _: self._sized())
        self._turn.on_update(lambda _: self._turned())
        for box in (self._shown, self._handles):
            box.on_update(lambda _: self.put(self._region))
        points.on_picked(self._picked)
        view.on_shown(lambda _: self._ask())
        view.on_stop(self._work.close)

    @property
    def region(self) -> Region | None:
        """The box, where it is shown."""
        return self._region if self._shown.value else None

    def on_told(self, listener: Callable[[], None]) -> None:
        """Call this when figures have changed."""
        self._listeners.append(listener)

    def selection(self) -> Mapping[str, PointCloud]:
        """The points of the box, by a name that tells of which cloud they are."""
        return {f"box of {name}": one.points for name, one in self.figures.items()}

    def put(
        self, region: Region | None, draw: Callable[[Region | None], None] | None = None
    ) -> None:
        """Set the box, and tell what lies in it."""
        with self._lock:
            self._region = region
            (draw or self._draw)(self.region)
            if region is not None and self._turn.value != _rounded(region.turn_deg):
                set_value(self._turn, _rounded(region.turn_deg))
        self._ask()

    def _draw(self, region: Region | None) -> None:
        self._drawn.show(region, handles=self._handles.value)

    def _picked(self, place_m: Float64) -> None:
        self._clicked.append(place_m)
        for button, needed in zip(self._buttons, (1, 2), strict=True):
            button.disabled = len(self._clicked) < needed

    def _here(self) -> None:
        clicked = list(self._clicked)
        if clicked:
            turn = 0.0 if self._region is None else self._region.turn_deg
            self.put(Region.about(clicked[-1], np.array(self._size.value)).turned(turn))

    def _between(self) -> None:
        clicked = list(self._clicked)
        if len(clicked) == 2:
            region = Region.between(clicked[0], clicked[1])
            with self._lock:
                self._region = region  # so that its size is not taken for one that somebody set
                set_value(self._size, tuple(np.round(region.size_m, 3).tolist()))
            self.put(region)

    def _sized(self) -> None:
        region, size_m = self._region, np.array(self._size.value)
        if region is not None and np.abs(region.size_m - size_m).max() > SAME_SIZE_M:
            self.put(region.sized(size_m))

    def _turned(self) -> None:
        region, turn = self._region, float(self._turn.value)
        if region is not None and turn != _rounded(region.turn_deg):
            self.put(region.turned(turn))

    def _dragged(self, T_local_box: Float64) -> None:
        if self._region is not None:
            self.put(replace(self._region, T_local_box=T_local_box), self._drawn.follow)

    def _to_plane(self) -> None:
        """Turned along the plane of the cloud that has most points on one."""
        every = [(one.flatness, len(one.points)) for one in self.figures.values()]
        flat = [(plane.share * count, plane) for plane, count in every if plane is not None]
        if self._region is None or not flat:
            return
        _, plane = max(flat, key=lambda one: one[0])
        region = self._region.along(plane.normal)
        T = region.T_local_box.copy()
        T[:3, 3] = plane.middle_m
        self.put(replace(region, T_local_box=T))

    def _ask(self) -> None:
        region = self.region
        if region is not None or self._asked is not None:
            self._asked = region
            self._work.ask(region)

    def _tell(self, region: Region | None, _overtaken: Callable[[], bool]) -> None:
        self.figures = figures = self._gatherer.figures(region)
        self._text.content = "" if region is None else table(figures)
        self._flush.disabled = all(one.flatness is None for one in figures.values())
        for listener in self._listeners:
            listener()


def _rounded(degrees: float) -> float:
    return round(round(degrees / TURN_STEP) * TURN_STEP, 3)
