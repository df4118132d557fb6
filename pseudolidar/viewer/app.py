"""The viewer as a whole: a server, what is looked at, and its panels."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Self

from pseudolidar.viewer.address import Address
from pseudolidar.viewer.boxes.gathered import Gatherer
from pseudolidar.viewer.comparing.joined import joined
from pseudolidar.viewer.drawn_cameras import DrawnCameras
from pseudolidar.viewer.drawn_ground import DrawnGround
from pseudolidar.viewer.drawn_meshes import DrawnMeshes
from pseudolidar.viewer.drawn_octrees import DrawnOctrees
from pseudolidar.viewer.drawn_path import DrawnPath
from pseudolidar.viewer.drawn_ruler import DrawnRuler
from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.means import NO_MEANS, Means
from pseudolidar.viewer.objects.scene import ObjectScene
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.panels.box import BoxPanel
from pseudolidar.viewer.panels.compare import ComparePanel
from pseudolidar.viewer.panels.detail import DetailPanel
from pseudolidar.viewer.panels.export import ExportPanel
from pseudolidar.viewer.panels.help import HelpPanel
from pseudolidar.viewer.panels.hue import HuePanel
from pseudolidar.viewer.panels.large_export import LargeExport
from pseudolidar.viewer.panels.obstacles import ObstaclesPanel
from pseudolidar.viewer.panels.paths import PathsPanel
from pseudolidar.viewer.panels.picture import PicturePanel
from pseudolidar.viewer.panels.picture_boxes import PictureBoxes
from pseudolidar.viewer.panels.points import PointsPanel
from pseudolidar.viewer.panels.run import RunPanel
from pseudolidar.viewer.panels.scene import ScenePanel
from pseudolidar.viewer.panels.time import TimePanel
from pseudolidar.viewer.panels.tune import TunePanel
from pseudolidar.viewer.reel import NoFrames, Reel, SourceReel
from pseudolidar.viewer.remembered import RememberedSights
from pseudolidar.viewer.server import GuardedServer, serve
from pseudolidar.viewer.view import View

TITLE = "pseudolidar"
# Where a camera looks from at first: behind the rig, above it, ahead; m.
FROM_M, AT_M = (-8.0, 0.0, 5.0), (12.0, 0.0, 0.0)
# From where something that lies still is looked at, as a share of its size.
FROM_SHARE = (-0.4, -0.2, 0.3)
# So that all names of tabs have room in one line.
NARROW_TABS = "<style>[role=tab]{padding-left:6px !important;padding-right:6px !important}</style>"


class App:
    """A viewer that serves.

    Args:
        server: with its guard.
        opened: what is looked at.
        means: what can be done with its frames.
    """

    def __init__(self, server: GuardedServer, opened: Opened, means: Means = NO_MEANS) -> None:
        sights = None if means.sighted is None else RememberedSights(means.sighted)
        reel = opened.reels[0] if opened.reels else NoFrames()
        self.view = View(server, reel)
        self.companions = joined(self.view, opened.reels)
        for still in opened.stills:
            self.view.stage.put(still)
        self.octrees = DrawnOctrees(server.viser, self.view.stage, self.view.stage.trees)
        self.view.on_shown(lambda _: self.octrees.wake())
        self.meshes = DrawnMeshes(server.viser, self.view.stage)
        self.view.on_shown(lambda _: self.meshes.redraw())
        self.view.on_stop(self.meshes.close)
        self.cameras = DrawnCameras(self.view)
        self.ground = DrawnGround(self.view)
        self.ruler = DrawnRuler(server.viser, lambda: self.ground.level_m)
        self.view.on_shown(lambda _: self.ruler.wake())
        self.view.on_stop(self.ruler.close)
        self._look_from()
        self.view.set_theme(dark=True)
        self.run = RunPanel(self.view, reel) if isinstance(reel, LiveReel) else None
        self.path = self._drawn_path(reel)
        if opened.reels and self.run is None:
            self.time = TimePanel(self.view)
        if opened.reels:
            self.picture = PicturePanel(self.view, sights)
        self.points = PointsPanel(self.view, (self.octrees, self.meshes))
        self.objects_shown: Callable[[], ObjectScene] = ObjectScene
        self._add_tabs(opened, sights, means)
        self._ended = threading.Event()

    def _drawn_path(self, reel: Reel) -> DrawnPath | None:
        """The way of what moves."""
        if isinstance(reel, NoFrames):
            return None
        return DrawnPath(self.view, reel.poses if isinstance(reel, SourceReel) else None)

    def _add_tabs(self, opened: Opened, sights: RememberedSights | None, means: Means) -> None:
        """Panels that are looked at one at a time; what to do comes first where nothing is open."""
        self.view.gui.add_html(NARROW_TABS)
        tabs = self.view.gui.add_tab_group()
        reel = self.view.reel
        workshop = means.workshop
        names = ["Scene", "Tune", "Obstacles", "Compare", "Points", "Export", "Help"]
        if workshop is None or not isinstance(reel, SourceReel):
            names.remove("Tune")
        if not opened.reels or (isinstance(reel, LiveReel) and not reel.finds):
            names.remove("Obstacles")
        elif isinstance(reel, LiveReel):  # what the run is for
            names = ["Obstacles", *(name for name in names if name != "Obstacles")]
        if opened.is_empty:
            names = ["Help", "Scene", "Export"]
        tab = {name: tabs.add_tab(name) for name in names}
        with tab["Scene"]:
            self.scene = ScenePanel(self.view, self.meshes, self.ground, self.ruler, self.cameras)
            self.paths = PathsPanel(self.view, self.path)
            self.detail = DetailPanel(self.view, self.octrees)
        if "Tune" in tab:
            assert workshop is not None
            assert isinstance(reel, SourceReel)
            with tab["Tune"]:
                self.tune = TunePanel(self.view, reel, workshop, self.picture)
                self.hue = HuePanel(self.view, self.picture)
        if "Obstacles" in tab:
            with tab["Obstacles"]:
                self.obstacles = ObstaclesPanel(self.view, sights, opened.objects, means.asked)
            self.objects_shown = lambda: self.obstacles.scene
            self.picture_boxes = PictureBoxes(self.view, self.picture, self.obstacles)
        if "Compare" in tab:
            with tab["Compare"]:
                self.compare = ComparePanel(self.view, self.companions, means.rigs)
        with tab["Export"]:
            filmed = self.obstacles.filmed if "Obstacles" in tab else None
            self.export = ExportPanel(self.view, filmed)
            self.large_export = LargeExport(self.view, self.octrees)
        if "Points" in tab:
            with tab["Points"]:
                gatherer = Gatherer(self.view, self.octrees)
                self.box = BoxPanel(self.view, self.points, gatherer)
            self.export.offer(self.box.selection)
            self.box.on_told(self.export.list_clouds)
        with tab["Help"]:
            self.help = HelpPanel(self.view, opened)

    def _look_from(self) -> None:
        camera = self.view.server.viser.initial_camera
        camera.position, camera.look_at = FROM_M, AT_M
        extent = self.view.stage.extent_m
        if extent is not None and isinstance(self.view.reel, NoFrames):
            (x, y, z), size_m = extent
            back, aside, up = (share * size_m for share in FROM_SHARE)
            camera.position, camera.look_at = (x + back, y + aside, z + up), (x, y, z)
            self.view.stage.show_axes(shown=False)

    @classmethod
    @contextlib.contextmanager
    def served(cls, address: Address, opened: Opened, means: Means = NO_MEANS) -> Iterator[Self]:
        """Serve what was opened, and end with the block.

        Raises:
            ServeError: the address cannot be had.
        """
        with cls.made(address, opened, means) as app:
            app.view.start()
            yield app

    @classmethod
    @contextlib.contextmanager
    def made(cls, address: Address, opened: Opened, means: Means = NO_MEANS) -> Iterator[Self]:
        """The same, with nothing drawn yet.

        Raises:
            ServeError: the address cannot be had.
        """
        server = serve(address, label=TITLE)
        try:
            app = cls(server, opened, means)
        except BaseException:
            server.stop()
            raise
        try:
            yield app
        finally:
            app.octrees.close()
            app.view.stop()

    @property
    def url(self) -> str:
        """Address with its token."""
        return self.view.server.url

    def wait(self) -> None:
        """Until the process is asked to end."""
        while not self._ended.wait(0.2):
            pass
