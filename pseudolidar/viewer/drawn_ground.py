"""The ground as a grid, and rings of range about the rig on it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.viewer.moment import VELODYNE, Moment
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.scales.ground import RANGES_M, ground_below_m, low_m, rings
from pseudolidar.viewer.scales.ruler import length_text
from pseudolidar.viewer.stage import MAP, RIG

if TYPE_CHECKING:
    from pseudolidar.viewer.view import View

RING_COLOUR, RING_PX = (110, 190, 255), 2.0
# They lie above the ground, so that its points do not hide them.
ABOVE_M = 0.1
# Cells of a grid: this share of what lies still, as a power of ten; of a sequence 1 m.
CELLS, SECTION = 100, 10
# It fades at so many cells from the eye.
FADES_CELLS = 80
# Frames in which the ground is looked for; a rig does not change its height.
TRIES = 5


class DrawnGround:
    """Made when it is first shown.

    Args:
        view: what is looked at.
    """

    def __init__(self, view: View) -> None:
        self._view = view
        self._scene = view.server.viser.scene
        self._grid: Any = None
        self._rings: Any = None
        self._below_m: float | None = None
        self._tries = TRIES
        self.has_rig = not isinstance(view.reel, NoFrames)
        self.cell_m = 1.0
        self._still_level_m = 0.0
        extent, places = view.stage.extent_m, view.stage.still_places
        if not self.has_rig and extent is not None:
            self._still_level_m = low_m(places) - float(view.stage.placement.origin_m[2])
            self.cell_m = 10.0 ** np.floor(np.log10(max(extent[1], 1e-3) / CELLS) + 0.5)
        view.on_shown(self._follow)

    @property
    def title(self) -> str:
        """What its lines are."""
        cell, section = (length_text(n * self.cell_m) for n in (1, SECTION))
        return f"Ground grid, {cell} and {section}"

    @property
    def level_m(self) -> float:
        """Height of the ground below the rig, or below what lies still, in the scene."""
        placement = self._view.stage.placement
        if self.has_rig:
            return float(placement.of_rig(np.array([0.0, 0.0, self._below_m or 0.0]))[2])
        return self._still_level_m

    def show_grid(self, *, shown: bool) -> None:
        """Draw the grid, or not."""
        if self._grid is None and shown:
            self._grid = self._scene.add_grid(
                f"{MAP}/grid",
                infinite_grid=True,
                cell_size=self.cell_m,
                section_size=SECTION * self.cell_m,
                fade_distance=FADES_CELLS * self.cell_m,
            )
        if self._grid is not None:
            self._grid.visible = shown
            self._place()

    def show_rings(self, *, shown: bool) -> None:
        """Draw the rings of range, or not."""
        if self._rings is None and shown:
            self._rings = self._scene.add_frame(f"{RIG}/rings", show_axes=False)
            self._scene.add_line_segments(
                f"{RIG}/rings/lines", rings(0.0), RING_COLOUR,
                thickness=RING_PX, thickness_units="screen",
            )  # fmt: skip
            for radius_m in RANGES_M:
                self._scene.add_label(
                    f"{RIG}/rings/{radius_m:g}", length_text(radius_m),
                    position=(radius_m, 0.0, 0.0), anchor="bottom-center",
                )  # fmt: skip
        if self._rings is not None:
            self._rings.visible = shown
            self._place()

    def _follow(self, moment: Moment) -> None:
        if self.has_rig and self._tries and self._below_m is None and moment.clouds:
            self._tries -= 1
            scan_first = sorted(moment.clouds, key=lambda name: name != VELODYNE)
            self._below_m = ground_below_m([moment.clouds[name] for name in scan_first])
        self._place()

    def _place(self) -> None:
        if self._rings is not None:
            self._rings.position = (0.0, 0.0, (self._below_m or 0.0) + ABOVE_M)
        if self._grid is not None:
            placement = self._view.stage.placement
            if self.has_rig:
                T = placement.T_local_rig
                below = T[:3, :3] @ np.array([0.0, 0.0, self._below_m or 0.0]) + T[:3, 3]
                self._grid.position = (0.0, 0.0, float(below[2]))
            else:
                self._grid.position = (0.0, 0.0, self._still_level_m)
