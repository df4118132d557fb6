"""What is in the way: found by a run or now, drawn in the scene, listed by distance."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.detector import Detector
from pseudolidar.obstacles.detectors import AnyDetector
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.structures.arrays import Float64
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.filming.outlined import FilmedObjects
from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.asking import (
    NONE,
    NOTHING_ASKED,
    OF_RUN,
    USUAL,
    Asked,
    detector_of,
    kinds,
)
from pseudolidar.viewer.objects.drawn import DrawnObjects
from pseudolidar.viewer.objects.in_picture import PictureBox, boxes_in_picture
from pseudolidar.viewer.objects.scene import ObjectScene, Parts
from pseudolidar.viewer.objects.teller import RunObjects, Wish
from pseudolidar.viewer.objects.watch import ObjectWatch
from pseudolidar.viewer.panels.obstacle_list import ObstacleList
from pseudolidar.viewer.remembered import RememberedSights
from pseudolidar.viewer.view import View

# Objects are looked for in so many frames ahead of the shown one.
AHEAD = 3
# From where a camera looks at an object, m: behind it and above.
BEHIND_M, ABOVE_M = 9.0, 4.0
FARTHEST_M, LARGEST_M = 120.0, 4.0
CORRIDOR = Corridor(2.0, 2.0, 30.0)
LEAST_CORRIDOR_M, LARGEST_CORRIDOR_M = (0.2, 0.2, 1.0), (20.0, 10.0, FARTHEST_M)
WORDS = "colour: red or 350-10; range: 2-20 (m); regions: LEFT,TOP,RIGHT,BOTTOM (px)"


class ObstaclesPanel:
    """Objects of the shown frame.

    Args:
        view: what is looked at.
        sights: a frame to what is seen in it; None where nothing can be measured.
        run: what a run found, by frame.
        asked: what is wanted from the start.
    """

    def __init__(
        self,
        view: View,
        sights: RememberedSights | None,
        run: RunObjects,
        asked: Asked = NOTHING_ASKED,
    ) -> None:
        self._view, self._asked = view, asked
        self._drawn = DrawnObjects(view.server.viser)
        self._parts = Parts()
        self._drawing = threading.Lock()
        self._fault, self._version = "", 0
        self.scene = ObjectScene()
        self._drawn_of: Moment | None = None
        self._loaded: tuple[AnyDetector, Detector] | None = None
        self.watch = ObjectWatch(sights, run, self._came)
        # A run that goes on finds by itself: there is nothing to ask for.
        self._live = isinstance(view.reel, LiveReel)
        self._controls(of_run=bool(run) or self._live)
        view.stage.followed = self._followed
        view.wait_for(self.watch.ready)
        view.on_shown(self._show)
        view.on_stop(self.watch.close)
        if sights is not None:
            sights.on_change(self._seen_otherwise)
        self._ask()

    def filmed(self) -> FilmedObjects:
        """The same objects for the frames of a film, from the first one on."""
        return FilmedObjects(self.watch.at_once(), self._parts)

    def _controls(self, *, of_run: bool) -> None:
        gui, asked = self._view.gui, self._asked
        every = kinds(of_run=of_run, given=asked.detector)
        self._kind = gui.add_dropdown(
            "Detector",
            (OF_RUN, NONE) if self._live else every,
            initial_value=asked.kind(of_run=of_run),
            hint="Who says where objects are. They are measured as `pseudolidar obstacles` does.",
        )
        self._words = gui.add_text("Which", "", visible=False, hint=WORDS)
        self._kind.on_update(lambda _: self._choose())
        ObstacleList(
            self._view,
            lambda: self.version,
            self._told,
            self.follow,
        )
        self._chosen_controls()
        self._limits()
        self._corridor_controls()
        self._part_controls()
        for control in (self._words, self._track, self._watched, self._size):
            control.on_update(lambda _: self._ask())

    def _chosen_controls(self) -> None:
        gui = self._view.gui
        self._follow = gui.add_checkbox(
            "Hold the chosen",
            False,
            hint="The scene moves, the chosen object stays where it is, as long as it is followed. "
            "A click on a line of the list holds it.",
        )
        self._look = gui.add_button("Look at the chosen one", disabled=True)
        self._follow.on_update(lambda _: self._hold())
        self._look.on_click(self._look_at)

    def _limits(self) -> None:
        gui = self._view.gui
        self._range = gui.add_multi_slider(
            "Distance, m", min=0.0, max=FARTHEST_M, step=1.0, initial_value=(0.0, FARTHEST_M)
        )
        self._least = gui.add_slider(
            "Size from, m", min=0.0, max=LARGEST_M, step=0.1, initial_value=0.0
        )
        for limit in (self._range, self._least):
            limit.on_update(lambda _: self._limit())

    def _corridor_controls(self) -> None:
        gui, corridor = self._view.gui, self._asked.corridor or CORRIDOR
        self._watched = gui.add_checkbox(
            "Watch a corridor",
            self._asked.corridor is not None,
            visible=not self._live,
            hint="The nearest thing ahead in it, whatever it is, and when it is reached.",
        )
        self._size = gui.add_vector3(
            "Width, height, length, m",
            (corridor.width_m, corridor.height_m, corridor.length_m),
            min=LEAST_CORRIDOR_M,
            max=LARGEST_CORRIDOR_M,
            step=0.1,
            visible=self._watched.value,
        )

    def _part_controls(self) -> None:
        gui, parts = self._view.gui, self._parts
        with gui.add_folder("Drawn", expand_by_default=False):
            boxes = gui.add_checkbox("Boxes and arrows", parts.boxes)
            labels = gui.add_slider("Words at", min=0, max=40, step=1, initial_value=parts.labels)
            points = gui.add_checkbox("Points in their colour", parts.points)
            truth = gui.add_checkbox("Labels of the data, white", parts.truth)
            self._track = gui.add_checkbox(
                "Follow from frame to frame",
                True,
                visible=not self._live,
                hint="Identity, speed, time to contact.",
            )
        boxes.on_update(lambda _: self._draw_parts(boxes=boxes.value))
        labels.on_update(lambda _: self._draw_parts(labels=int(labels.value)))
        points.on_update(lambda _: self._draw_parts(points=points.value))
        truth.on_update(lambda _: self._draw_parts(truth=truth.value))

    def _choose(self) -> None:
        kind = self._kind.value
        self._words.visible = kind in USUAL
        if kind in USUAL and self._words.value != USUAL[kind]:
            set_value(self._words, USUAL[kind])  # which asks
        else:
            self._ask()

    def _ask(self) -> None:
        """Find what the controls say."""
        self._size.visible = self._watched.value
        self._fault = ""
        detect = None
        try:
            detect = self._detector()
        except PseudolidarError as error:
            self._fault = str(error)
        corridor = Corridor(*self._size.value) if self._watched.value else None
        tracker = Tracker() if self._track.value else None
        self.watch.ask(Wish(self._kind.value == OF_RUN, detect, corridor, tracker))
        self._again()

    def _detector(self) -> Detector | None:
        """The one that the controls say, loaded once as long as they say the same."""
        settings = detector_of(self._kind.value, self._words.value, self._asked.detector)
        if settings is None:
            return None
        if self._loaded is None or self._loaded[0] != settings:
            self._loaded = settings, self._asked.loaded(settings)
        return self._loaded[1]

    def _seen_otherwise(self) -> None:
        self.watch.again()
        self._again()

    def _hold(self) -> None:
        self._view.stage.placement.let_go()
        self._view.redraw()

    def _limit(self) -> None:
        near_m, far_m = self._range.value
        band = self.watch.band
        far_m = far_m if far_m < FARTHEST_M else np.inf
        self.watch.band = replace(band, near_m=near_m, far_m=far_m, least_m=self._least.value)
        self._again()

    def _draw_parts(self, **changes: Any) -> None:
        self._parts = replace(self._parts, **changes)
        self._again()

    def _came(self, index: int) -> None:
        """Objects of a frame were found."""
        moment = self._view.moment
        if moment is None or moment.index != index:
            return
        if self._follow.value:  # where the map lies depends on it
            self._view.redraw()
        else:
            self._draw(moment)

    def _again(self) -> None:
        moment = self._view.moment
        if moment is not None:
            self._show(moment)

    def _show(self, moment: Moment) -> None:
        view = self._view
        following = (view.ready.get(index) for index in view.timeline.ahead(1 + AHEAD)[1:])
        self.watch.want([moment, *(one for one in following if one is not None)])
        self._draw(moment)

    def _draw(self, moment: Moment) -> None:
        with self._drawing:
            if moment is not self._view.moment:  # a later one was shown meanwhile
                return
            self.scene, self._drawn_of = self.watch.scene(moment), moment
            self._drawn.show(self.scene, self._parts)
            self._look.disabled = self.scene.chosen_one is None
            self._version += 1

    def _followed(self, moment: Moment) -> Float64 | None:
        """(3,) what stays in place while the map moves, in the frame of the clouds."""
        if not self._follow.value:
            return None
        chosen = self.watch.scene(moment).chosen_one
        if chosen is None or chosen.obstacle.track is None:  # the next frame's is another one
            return None
        return chosen.middle_m

    def _look_at(self, event: Any) -> None:
        chosen, client = self.scene.chosen_one, event.client
        if chosen is None or client is None:
            return
        placement = self._view.stage.placement
        behind = chosen.middle_m + np.array([-BEHIND_M, 0.0, ABOVE_M])
        client.camera.position = placement.of_rig(behind)
        client.camera.look_at = placement.of_rig(chosen.middle_m)

    @property
    def version(self) -> str:
        """Changes with what is drawn."""
        return f"{self._view.version}.{self._version}"

    def choose(self, key: str) -> None:
        """Choose one of the shown objects, by its key; any other key is none."""
        self.watch.chosen = key if key in {one.key for one in self.scene.objects} else ""
        if self._follow.value:
            self._hold()
        self._again()

    def follow(self, key: str) -> None:
        """Choose an object and hold it in place; one that is chosen already is let go.

        Args:
            key: of the object; a key that nothing has chooses none.
        """
        if key == self.scene.chosen:
            key = ""
        elif not self._follow.value and key in {one.key for one in self.scene.objects}:
            set_value(self._follow, True)
        self.choose(key)

    def in_picture(self, *, right: bool) -> tuple[PictureBox, ...]:
        """Boxes over the left or the right picture of the frame that is drawn."""
        with self._drawing:
            scene, moment = self.scene, self._drawn_of
        if moment is None:
            return ()
        truths = scene.truths if self._parts.truth else ()
        return boxes_in_picture(replace(scene, truths=truths), moment, right=right)

    def _told(self) -> ObjectScene:
        scene = self.scene
        return replace(scene, text=self._fault or scene.text)
