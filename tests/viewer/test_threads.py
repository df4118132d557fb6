"""What browsers ask for while the next frame is drawn: old or new, and never half of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.panels import picture
from pseudolidar.viewer.panels.picture import PicturePanel
from pseudolidar.viewer.panels.points import PointsPanel
from pseudolidar.viewer.stage import Stage
from pseudolidar.viewer.stills import StillCloud

CLOUD = PointCloud(np.float32([[5, 0, 0], [5, 1, 0]]), "map")
FORWARD = np.array([1.0, 0, 0])


@pytest.fixture
def app() -> Iterator[App]:
    with App.made(Address(port=0), Opened(stills=(StillCloud("a", CLOUD),))) as made:
        yield made


def moment(*names: str) -> Moment:
    return Moment("", 0, clouds=dict.fromkeys(names, CLOUD))


def test_a_frame_that_is_being_drawn_is_not_seen_in_part(app: App, monkeypatch: pytest.MonkeyPatch):
    stage, seen = app.view.stage, list[tuple[str, ...]]()
    drawn = Stage._update

    def update(self: Stage, *what: Any) -> None:
        seen.append(tuple(self.shown))
        drawn(self, *what)

    monkeypatch.setattr(Stage, "_update", update)
    stage.show(moment("one", "two"))
    stage.show(moment("two", "three"))
    assert seen == [(), (), ("one", "two"), ("one", "two")]
    assert tuple(stage.shown) == ("two", "three")


def test_who_goes_through_clouds_may_go_on_when_another_is_laid_down(app: App):
    stage = app.view.stage
    going = iter(stage.stills.items())
    assert next(going)[0] == "a"
    stage.put(StillCloud("b", CLOUD))
    assert not list(going)
    assert set(stage.stills) == {"a", "b"}


def test_what_is_laid_down_is_drawn_by_the_thread_that_draws(app: App):
    app.view.lay(StillCloud("b", CLOUD))
    assert set(app.view.stage.stills) == {"a"}
    app.view.tick(0.0)
    assert set(app.view.stage.stills) == {"a", "b"}


def test_of_two_points_of_one_frame_the_distance_is_told(app: App):
    for y in (0.0, 1.0):
        app.points.click(np.array([0.0, y, 0.0]) - app.view.stage.placement.origin_m, FORWARD)
    assert "**1.000 m** apart" in app.points._text.content
    app.points._forget(moment())
    app.points.click(-app.view.stage.placement.origin_m, FORWARD)
    assert "apart" not in app.points._text.content


class Forgetting(PointsPanel):
    """Forgets the last point once it was looked at, as a frame does that is drawn meanwhile."""

    kept: Any = None

    @property
    def _last(self) -> Any:
        last, self.kept = self.kept, None
        return last

    @_last.setter
    def _last(self, last: Any) -> None:
        self.kept = last


def test_a_point_that_is_forgotten_while_another_is_told_is_no_fault(app: App):
    panel = Forgetting(app.view, (app.octrees,))
    for _ in range(2):
        panel.click(-app.view.stage.placement.origin_m, FORWARD)
    assert "**0.000 m** apart" in panel._text.content


class Watched:
    """A view whose frame gives way to another one as soon as somebody measures in it."""

    def __init__(self) -> None:
        self.drawn = list[Any]()
        self.moment = replace(moment(), converted=SimpleNamespace(frame=None))  # type: ignore[arg-type]
        self.stage = SimpleNamespace(of_camera=lambda place: place)
        self.marks = SimpleNamespace(show_box=self.drawn.append, show_place=self.drawn.append)

    def go_on(self) -> None:
        self.moment = replace(self.moment)


@pytest.mark.parametrize("goes_on", [False, True])
def test_what_is_measured_is_drawn_into_its_own_frame_only(
    monkeypatch: pytest.MonkeyPatch, *, goes_on: bool
):
    view = Watched()
    panel = PicturePanel.__new__(PicturePanel)
    panel._view, panel._pickers = view, []  # type: ignore[assignment]

    def measured(*_: object) -> list[Any]:
        if goes_on:
            view.go_on()
        return [SimpleNamespace(box="box", measured_by="size", distance_m=1.0)]

    def pixel_of(*_: object) -> Any:
        measured()
        return SimpleNamespace(depth_m=1.0, xyz_m="place", text="")

    panel._sights = lambda _frame: SimpleNamespace(sight=None)  # type: ignore[assignment]
    monkeypatch.setattr(picture, "measured", measured)
    monkeypatch.setattr(picture, "pixel_of", pixel_of)
    monkeypatch.setattr(picture, "kinds", lambda _: {"left"})
    answer = panel._measure({"left": "0", "top": "0", "right": "1", "bottom": "1"})
    assert b"distance_m" in answer.body
    panel._pixel({"x": "0", "y": "0", "mark": ""})
    assert view.drawn == ([] if goes_on else ["box", "place"])
