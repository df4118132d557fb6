"""What somebody points at in the shown frame: a place, and a box that was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import BOX_EDGES, Box3D
from pseudolidar.viewer.moment import Sight
from pseudolidar.viewer.stage import RIG

if TYPE_CHECKING:
    from viser import ViserServer

MARK_M, MARK_COLOUR = 0.12, (255, 80, 80)
BOX_COLOUR, LINE_PX = (255, 212, 59), 2.0


class DrawnMarks:
    """Nodes that are made when they are first wanted, and gone with the next frame.

    Args:
        server: draws.
    """

    def __init__(self, server: ViserServer) -> None:
        self._scene = server.scene
        self._sight: Sight | None = None
        self._place: Any = None
        self._box: Any = None

    def begin(self, sight: Sight | None) -> None:
        """Nothing is marked in a new frame.

        Args:
            sight: its camera; None where it has none.
        """
        self._sight = sight
        for node in (self._place, self._box):
            if node is not None:
                node.visible = False

    def show_place(self, place_m: Float64 | None) -> None:
        """Mark a place (3,) in the scene, or none."""
        if self._place is None:
            self._place = self._scene.add_icosphere(
                "/mark", radius=MARK_M, color=MARK_COLOUR, visible=False
            )
        self._place.visible = place_m is not None
        if place_m is not None:
            self._place.position = place_m

    def show_box(self, box: Box3D) -> None:
        """Draw a box of the left camera's frame, if there is a camera."""
        if self._sight is None:
            return
        corners = np.array([self._sight.forward(corner) for corner in box.corners_m()])
        edges = np.array([[corners[a], corners[b]] for a, b in BOX_EDGES], np.float32)
        if self._box is None:
            self._box = self._scene.add_line_segments(
                f"{RIG}/measured", edges, BOX_COLOUR, thickness=LINE_PX, thickness_units="screen"
            )
        self._box.points, self._box.visible = edges, True
