"""The Tune tab without a browser: what is measured by, and what is told of frames."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pseudolidar.pipelines.convert import Convert, opened

from pseudolidar.errors import StereoConfig
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.picture import PicturePanel
from pseudolidar.viewer.panels.tune import BACK, DEFAULTS, KEEP, UNDO, TunePanel
from pseudolidar.viewer.reel import SourceReel
from pseudolidar.viewer.remembered import RememberedSights
from pseudolidar.viewer.tuning.figures import FrameFigures
from pseudolidar.viewer.tuning.judge import Judge, Judged
from pseudolidar.viewer.tuning.tuner import Workshop
from pseudolidar.viewer.view import View

JOB = Convert(Synthetic("street", frames=1, width_px=200))


def never(_job):
    raise StereoConfig("never", want="something else")


@pytest.fixture
def sights() -> RememberedSights:
    return RememberedSights(lambda _frame: JOB)


@pytest.fixture
def panel(server, sights) -> Iterator[TunePanel]:
    """Of settings that are refused, whatever they are; what is seen is the settings."""
    reel = SourceReel(opened(JOB), None)
    view = View(server, reel)
    shop = Workshop(JOB, never, lambda job: lambda _frame: job)
    yield TunePanel(view, reel, shop, PicturePanel(view, sights))
    view.stop()


def turn(panel: TunePanel, name: str, value: object) -> None:
    part = panel._bench.parts["matcher"]
    (knob,) = [one for one in part.knobs["census"] if one.name == name]
    panel.turn(part, knob, value)


def test_what_is_refused_is_not_measured_by(panel, sights):
    seen = []
    sights.on_change(lambda: seen.append(sights(object()).matcher))
    turn(panel, "uniqueness_percent", 20)
    assert panel.tuner.idle(10)
    assert seen == [Census(uniqueness_percent=20), Census()]
    assert panel._bench.job == JOB
    assert "never" in panel._said.content


def test_what_is_measured_stays_where_only_the_shown_one_changes(panel, sights):
    seen = []
    sights.on_change(lambda: seen.append(sights(object())))
    panel.press(KEEP)
    assert panel._shown.visible
    panel._shown.value = "A, as kept"
    assert seen == []


def test_buttons_do_what_they_say(panel):
    panel.tuner.ask = lambda _wanted: None
    turn(panel, "uniqueness_percent", 20)
    panel.press(KEEP)
    panel.press(DEFAULTS)
    assert panel._bench.job.matcher == Census()
    panel.press(BACK)
    assert panel._bench.job.matcher == Census(uniqueness_percent=20)
    panel.press(UNDO)
    assert panel._bench.job.matcher == Census()
    panel.press("no button")
    assert panel._bench.job.matcher == Census()


def test_a_frame_with_a_fault_has_no_figures(panel):
    told = []
    judge = Judge(told.append)
    judge.ask(Moment("a", 0, fault="cut off"))
    assert judge._latest.idle(5)
    judge.close()
    (judged,) = told
    assert judged.rows == ()
    panel._judged(Judged(judged.moment, (("now", FrameFigures(0.5, 100)),)))
    assert "50.00 %" in panel._figures.content
    panel._judged(judged)
    assert panel._figures.content == panel._ranges.content == ""
    assert not panel._by_range.visible
