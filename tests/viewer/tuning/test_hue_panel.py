"""The colour detector's controls without a browser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from pseudolidar.obstacles.hues import NAMED, Hues
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.hue import HINT, HuePanel
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.view import View
from tests.obstacles.scene import CAMERA, HEIGHT, WIDTH


@dataclass
class Picture:
    """Sees the same in every frame; something may happen meanwhile."""

    meanwhile: list = field(default_factory=list)
    asked: list[Moment] = field(default_factory=list)

    def on_pick(self, _picker):
        """Nobody clicks."""

    def add_layer(self, _name, layer):
        self.layer = layer

    def seen(self, moment):
        self.asked.append(moment)
        for each in self.meanwhile:
            each()
        image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        image[100:160, 200:260] = (200, 30, 40)
        depth = DepthMap(np.full((HEIGHT, WIDTH), 6, np.float32), None)
        return SimpleNamespace(sight=Sight("0", image, CAMERA, depth))


@pytest.fixture
def panel(server) -> Iterator[HuePanel]:
    view = View(server, NoFrames())
    view.moment = Moment("a", 0)
    yield HuePanel(view, Picture())
    view.stop()


def found(panel: HuePanel) -> Moment | None:
    assert panel._latest.idle(10)
    return None if panel._found is None else panel._found[0]


def test_what_is_found_is_of_the_frame_that_was_looked_into(panel):
    first, later = panel._view.moment, Moment("b", 1)
    panel._picture.meanwhile.append(lambda: setattr(panel._view, "moment", later))
    panel._on.value = True
    assert found(panel) is first
    assert panel._picture.asked == [first]
    assert panel._picture.layer.there(first)
    assert not panel._picture.layer.there(later)
    assert "--detector colour" in panel._text.content


def test_nothing_is_drawn_that_is_found_after_it_was_switched_off(panel):
    panel._picture.meanwhile.append(lambda: setattr(panel._on, "value", False))
    panel._on.value = True
    assert found(panel) is None
    assert panel._text.content == HINT


def test_colours_are_chosen_by_name(panel):
    panel._named.value = "blue"
    assert panel.colour.hues == Hues(*NAMED["blue"])
    assert [end.value for end in panel._ends] == list(NAMED["blue"])
