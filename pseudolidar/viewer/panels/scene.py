"""Which clouds and meshes are drawn, what their colours mean, how large their points are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import Colouring, Scale, ways
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.drawn_cameras import DrawnCameras
from pseudolidar.viewer.drawn_ground import DrawnGround
from pseudolidar.viewer.drawn_meshes import DrawnMeshes
from pseudolidar.viewer.drawn_ruler import DrawnRuler
from pseudolidar.viewer.moment import VELODYNE, Moment
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.view import View

# Of a scan the points are few: they are drawn larger, in a colour of their own.
SCAN_LOOK = Look(Colouring("range"), point_m=0.06)
# What the ends of a bar are called, and those of errors, which are white in the middle.
ENDS, SIGNED_ENDS = "Blue, red", "Too near, too far"


class ScenePanel:
    """A folder for each cloud, and what is drawn besides.

    Args:
        view: what is looked at.
        meshes: that lie in it.
        ground: the grid, and rings of range.
        ruler: the scale bar.
        cameras: of the rig.
    """

    def __init__(
        self,
        view: View,
        meshes: DrawnMeshes,
        ground: DrawnGround,
        ruler: DrawnRuler,
        cameras: DrawnCameras,
    ) -> None:
        self._view, self._meshes, self._cameras = view, meshes, cameras
        self._folders: dict[str, ColourControls] = {}
        gui = view.gui
        view.stage.looks.setdefault(VELODYNE, SCAN_LOOK)
        self._clouds = gui.add_folder("Clouds", visible=False)
        self._surfaces = gui.add_folder("Meshes", visible=False)
        for name, points in meshes.points.items():
            self._add_mesh(name, points)
        with gui.add_folder("Scene", expand_by_default=False):
            follow = gui.add_checkbox("Follow the rig", initial_value=True)
            axes = gui.add_checkbox("Axes", initial_value=True)
            self._seen = gui.add_checkbox("Cameras", initial_value=True, visible=False)
            bar = gui.add_checkbox("Scale bar", initial_value=True)
            rings = gui.add_checkbox("Rings of range", initial_value=False, visible=ground.has_rig)
            grid = gui.add_checkbox(ground.title, initial_value=False)
            dark = gui.add_checkbox("Dark", initial_value=True)
        key = gui.add_command("Follow the rig, or stay with the map", hotkey="F")
        key.on_trigger(lambda _: set_value(follow, not follow.value))
        follow.on_update(lambda _: self._follow(following=follow.value))
        axes.on_update(lambda _: view.stage.show_axes(shown=axes.value))
        self._seen.on_update(lambda _: cameras.show(shown=self._seen.value))
        bar.on_update(lambda _: ruler.show(shown=bar.value))
        rings.on_update(lambda _: ground.show_rings(shown=rings.value))
        grid.on_update(lambda _: ground.show_grid(shown=grid.value))
        dark.on_update(lambda _: view.set_theme(dark=dark.value))
        for name, cloud in view.stage.stills.items():
            self._add(name, cloud)
            self._folders[name].show()
        view.on_shown(self._show)

    def _follow(self, *, following: bool) -> None:
        self._view.stage.placement.follow = following
        self._view.redraw()

    def _show(self, moment: Moment) -> None:
        if self._cameras.there:
            self._seen.visible = True
        for name in moment.clouds:
            if name not in self._folders:
                self._add(name, moment.clouds[name], judged=name in moment.makings)
        for name, cloud in self._view.stage.stills.items():
            if name not in self._folders:  # laid down meanwhile
                self._add(name, cloud)
        for name, points in self._meshes.points.items():
            if name not in self._folders:
                self._add_mesh(name, points)
        for controls in self._folders.values():
            controls.show()

    def _add(self, name: str, cloud: PointCloud, *, judged: bool = False) -> None:
        gui, look = self._view.gui, self._view.stage.look(name)
        self._clouds.visible = True
        with self._clouds, gui.add_folder(name):
            controls = self._folders[name] = ColourControls(self._view, name, cloud, judged=judged)
            size = gui.add_slider(
                "Point, m", min=0.005, max=0.3, step=0.005, initial_value=look.point_m
            )
        size.on_update(lambda _: controls.set(point_m=size.value))

    def _add_mesh(self, name: str, points: PointCloud) -> None:
        gui, look = self._view.gui, self._view.stage.look(name)
        self._surfaces.visible = True
        with self._surfaces, gui.add_folder(name):
            controls = self._folders[name] = ColourControls(self._view, name, points)
            edges = gui.add_checkbox("Wireframe", initial_value=look.edges)
        controls.show()
        edges.on_update(lambda _: controls.set(edges=edges.value))


class ColourControls:
    """Whether a thing is drawn, and what its colours mean.

    Args:
        view: what is looked at.
        name: of the cloud or mesh.
        cloud: its points, which say what colours can mean.
        judged: whether its errors can be told, when they are asked for.
    """

    def __init__(self, view: View, name: str, cloud: PointCloud, *, judged: bool = False) -> None:
        self._view, self._name = view, name
        self._told: Scale | None = None
        gui, look = view.gui, view.stage.look(name)
        possible = ways(cloud, judged=judged)
        chosen = look.colouring.by if look.colouring.by in possible else possible[-1]
        self._visible = gui.add_checkbox("Shown", initial_value=look.visible)
        self._by = gui.add_dropdown("Colour", possible, initial_value=chosen)
        self._bar = gui.add_image(np.zeros((14, 256, 3), np.uint8), visible=False)
        self._ends = gui.add_vector2("Blue, red", (0.0, 1.0), step=0.01, visible=False)
        self._visible.on_update(lambda _: self.set(visible=self._visible.value))
        self._by.on_update(lambda _: self._set_colouring())
        self._ends.on_update(lambda _: self._set_ends())

    def _set_colouring(self) -> None:
        colouring = self._view.stage.look(self._name).colouring
        self.set(colouring=replace(colouring, by=self._by.value, low=None, high=None))
        looks = tuple(self._view.stage.looks.values())
        self._view.judge(wanted=any(look.colouring.by == "error" for look in looks))

    def set(self, **changes: Any) -> None:
        """Change the look."""
        stage = self._view.stage
        stage.looks[self._name] = replace(stage.look(self._name), **changes)
        self._view.redraw()

    def _set_ends(self) -> None:
        low, high = self._ends.value
        shown = self._view.stage.scale(self._name)
        if high > low and (shown is None or (low, high) != _rounded(shown)):
            colouring = self._view.stage.look(self._name).colouring
            self.set(colouring=replace(colouring, low=low, high=high))

    def show(self) -> None:
        """Draw the bar of the colours that are shown."""
        scale = self._view.stage.scale(self._name)
        self._bar.visible = self._ends.visible = scale is not None
        if scale is not None and scale != self._told:
            self._told = scale
            set_value(self._ends, _rounded(scale))
            self._bar.image = scale.picture()
            unit = f", {scale.unit}" if scale.unit else ""
            self._ends.label = f"{SIGNED_ENDS if scale.signed else ENDS}{unit}"


def _rounded(scale: Scale) -> tuple[float, float]:
    """Both ends as the page shows them."""
    return round(scale.low, 3), round(scale.high, 3)
