"""The Obstacles tab without a browser: what is asked for, and what is held in place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import StereoConfig
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.obstacles.colour import Colour
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.recorded import DepthFrame
from pseudolidar.viewer.moment import Moment, Sight
from pseudolidar.viewer.objects.scene import ObjectScene, Parts
from pseudolidar.viewer.objects.shown import Band, ShownObject
from pseudolidar.viewer.panels.obstacles import ObstaclesPanel
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.remembered import RememberedSights
from pseudolidar.viewer.view import View
from tests.formats.made_obstacles import car
from tests.obstacles.scene import CAMERA, HEIGHT, WIDTH
from tests.viewer.clients import wait_until


def refusing(why):
    def sighted(_frame):
        raise StereoConfig(why, want="something else")

    return sighted


@pytest.fixture
def sights() -> RememberedSights:
    return RememberedSights(refusing("first"))


@pytest.fixture
def panel(server, sights) -> Iterator[ObstaclesPanel]:
    view = View(server, NoFrames())
    picture = np.zeros((HEIGHT, WIDTH), np.uint8)
    depth = DepthMap(np.ones((HEIGHT, WIDTH), np.float32), None)
    frame = DepthFrame(picture, depth, CAMERA, "a", 0, 0)
    T = np.eye(4)
    T[:3, :3] = R_BODY_OPTICAL
    cloud = PointCloud(np.zeros((1, 3), np.float32), "camera_left")
    view.moment = Moment("a", 0, sight=Sight(CAMERA, T), converted=Converted(frame, cloud))
    made = ObstaclesPanel(view, sights, {})
    yield made
    view.stop()


def test_what_is_seen_otherwise_is_found_anew(panel, sights):
    panel._kind.value = "labels"
    wait_until(lambda: "first" in panel.scene.text)
    sights.change(refusing("second"))
    wait_until(lambda: "second" in panel.scene.text)


def test_a_detector_is_loaded_once_for_its_settings(panel, monkeypatch):
    loads, load = [], Colour.load
    monkeypatch.setattr(Colour, "load", lambda self: loads.append(self) or load(self))
    asks, ask = [], panel.watch.ask
    monkeypatch.setattr(panel.watch, "ask", lambda wish: asks.append(wish) or ask(wish))
    panel._kind.value = "colour"
    assert len(asks) == 1
    panel._watched.value = True
    panel._track.value = False
    assert len(asks) == 3
    assert len(loads) == 1
    assert asks[0].detect is asks[2].detect
    panel._words.value = "blue"
    assert len(loads) == 2
    panel._kind.value = "none"
    panel._kind.value = "colour"  # its usual words again
    assert [wish.detect is None for wish in asks[3:]] == [False, True, False]


def test_only_what_is_followed_is_held(panel, monkeypatch):
    panel._follow.value = True
    T = np.eye(4)
    for one, held in ((car(), True), (replace(car(), track=None), False)):
        shown = ShownObject.of(1, one, T)
        scene = ObjectScene(objects=(shown,), chosen=shown.key)
        monkeypatch.setattr(panel.watch, "scene", lambda _moment, scene=scene: scene)
        place = panel._followed(panel._view.moment)
        assert (place is not None) is held
        assert not held or np.array_equal(place, shown.middle_m)


def test_a_click_on_a_line_follows_until_it_is_let_go(panel, monkeypatch):
    one, other = (ShownObject.of(n, car(), np.eye(4)) for n in (1, 2))
    other = replace(other, key="track 9")

    def scene(_moment=None) -> ObjectScene:
        return ObjectScene(objects=(one, other), chosen=panel.watch.chosen)

    monkeypatch.setattr(panel.watch, "scene", scene)
    panel.scene = scene()
    panel.choose(one.key)  # as a click into the picture does
    assert panel._followed(panel._view.moment) is None
    panel.follow(other.key)
    assert panel._follow.value
    assert panel.scene.chosen == other.key
    assert panel._followed(panel._view.moment) is not None
    panel._follow.value = False
    assert panel.scene.chosen == other.key
    assert panel._followed(panel._view.moment) is None
    panel.follow(one.key)
    assert panel._followed(panel._view.moment) is not None
    panel.follow(one.key)  # again: nothing is chosen any more
    assert panel.scene.chosen == ""
    assert panel._followed(panel._view.moment) is None
    panel._follow.value = False
    panel.follow("nobody")
    assert panel.scene.chosen == ""
    assert not panel._follow.value


def test_a_film_has_the_detector_the_limits_and_the_parts_that_are_chosen(panel):
    panel._kind.value = "labels"
    panel._watched.value = True
    panel._range.value = (5.0, 20.0)
    panel._draw_parts(labels=3)
    filmed = panel.filmed()
    assert filmed.parts == Parts(labels=3)
    assert filmed.scenes.band == Band(5, 20, 0)
    assert filmed.scenes.teller.wish.detect is panel._loaded[1]
    assert filmed.scenes.teller.wish.corridor is not None
    assert "first" in filmed.scenes(panel._view.moment).text  # it is looked for at once
