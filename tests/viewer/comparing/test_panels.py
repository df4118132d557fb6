"""The Compare tab without a browser: clouds in turn, figures of all frames."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud
from pseudolidar.viewer.comparing.arrangement import ASIDE, FIRST, IN_TURN, ONLY, OVER, groups_of
from pseudolidar.viewer.comparing.companions import Companion, Companions
from pseudolidar.viewer.comparing.joined import join
from pseudolidar.viewer.comparing.pool import EVERY
from pseudolidar.viewer.comparing.turns import Turns
from pseudolidar.viewer.moment import STEREO, VELODYNE, Moment
from pseudolidar.viewer.panels import beside
from pseudolidar.viewer.panels.beside import BesidePanel
from pseudolidar.viewer.panels.compare import ComparePanel
from pseudolidar.viewer.server import GuardedServer
from pseudolidar.viewer.stills import StillCloud
from pseudolidar.viewer.view import View


def cloud() -> PointCloud:
    rng = np.random.default_rng(1)
    return PointCloud(rng.uniform((4, -6, -1), (18, 6, 2), (300, 3)).astype(np.float32), "velodyne")


@dataclass(frozen=True)
class Given:
    """A reel of two frames with two clouds each."""

    name: str = "given"
    ids: tuple[str, ...] = ("a", "b")
    times_s: tuple[float, ...] = (0.0, 0.1)

    def load(self, index: int) -> Moment:
        clouds = {STEREO: cloud(), VELODYNE: cloud()}
        return Moment(self.ids[index], index, clouds=clouds)


@pytest.fixture
def view(server: GuardedServer) -> Iterator[View]:
    made = View(server, Given())
    made.stage.show(made.made(0))
    yield made
    made.stop()


def hidden(view: View) -> set[str]:
    return {name for name in view.stage.shown if not view.stage._is_visible(name)}


def test_only_clouds_are_shown_in_turn():
    clouds, stills = (STEREO, "stereo A", VELODYNE), ("map.ply",)
    assert groups_of(clouds, [], (STEREO, "ground truth")) == {STEREO: (STEREO,)}
    every = groups_of(clouds, [], (EVERY, VELODYNE), makings=clouds[:2])
    assert every == {name: (name,) for name in clouds}
    assert list(groups_of(clouds, [], (STEREO, "map.ply"), stills=stills)) == [STEREO, "map.ply"]
    reel = Given()
    run = Companion.of("run", reel, reel)
    assert list(groups_of(clouds, [run], (EVERY, VELODYNE), stills=stills)) == [FIRST, "run"]
    assert groups_of(clouds, [run], ("", ""), stills=stills)[FIRST] == (STEREO, "stereo A")


def test_clouds_are_shown_one_at_a_time_and_aside(view: View):
    panel = BesidePanel(view, Companions())
    panel.choose(STEREO, VELODYNE)
    assert panel._mode.options == (OVER, IN_TURN, ASIDE, f"{ONLY}{STEREO}", f"{ONLY}{VELODYNE}")
    panel._step()
    assert hidden(view) == {VELODYNE}
    assert panel._text.content == f"Now shown: **{STEREO}**"
    panel._step()
    assert hidden(view) == {STEREO}
    panel._mode.value = ASIDE
    assert hidden(view) == set()
    assert panel._apart.visible
    panel._apart.value = 7.0
    assert np.allclose(view.stage._clouds[VELODYNE].position, (0, -7, 0))
    panel._mode.value = f"{ONLY}{VELODYNE}"
    panel.choose(STEREO, "ground truth")  # no cloud: nothing is left that could be shown alone
    assert panel._mode.value == OVER
    assert hidden(view) == set()
    companions = panel._companions
    join(view, companions, Companion.of("run", Given(), Given()))
    view.stage.show(view.made(0))
    panel._arrange()
    assert panel._mode.options[3:] == (f"{ONLY}{FIRST}", f"{ONLY}run")


def test_a_map_and_every_stereo_cloud_are_shown_in_turn(view: View):
    panel = BesidePanel(view, Companions())
    view.stage.put(StillCloud("map.ply", cloud()))
    panel.choose(STEREO, "map.ply")
    assert list(panel.groups) == [STEREO, "map.ply"]
    moment = view.made(0)
    made = Converted(RecordedCloud(cloud(), "a", 0, 0), cloud())
    view.moment = replace(moment, makings={STEREO: made})
    panel.choose(EVERY, VELODYNE)
    assert list(panel.groups) == [STEREO, VELODYNE]


def test_turns_follow_one_another(view: View):
    panel = BesidePanel(view, Companions())
    panel.choose(STEREO, VELODYNE)
    panel._turns.run = lambda *, wanted: None  # type: ignore[method-assign]
    panel._mode.value = IN_TURN
    assert hidden(view) == {VELODYNE}
    panel._next_turn()
    assert hidden(view) == {STEREO}


def test_a_turn_does_not_undo_what_is_chosen_meanwhile(view: View, monkeypatch: pytest.MonkeyPatch):
    panel = BesidePanel(view, Companions())
    panel.choose(STEREO, VELODYNE)
    begun, chosen = threading.Event(), threading.Event()

    def slow(arrangement: Any, **changes: Any) -> Any:
        if "turn" in changes:
            begun.set()
            chosen.wait(0.2)
        return replace(arrangement, **changes)

    monkeypatch.setattr(beside, "replace", slow)
    turn = threading.Thread(target=panel._next_turn)
    turn.start()
    assert begun.wait(60)
    panel._mode.value = ASIDE
    chosen.set()
    turn.join()
    assert (panel._arrangement.mode, panel._arrangement.turn) == (ASIDE, 1)


def test_turns_go_on_after_one_that_breaks(caplog: pytest.LogCaptureFixture):
    again, count = threading.Event(), 0

    def odd() -> None:
        nonlocal count
        count += 1
        if count == 1:
            raise ZeroDivisionError
        again.set()

    turns = Turns(odd, pace_s=0.01)
    turns.run(wanted=True)
    assert again.wait(60)
    turns.close()
    assert "a turn was not taken" in caplog.text


def test_errors_of_all_frames_are_of_what_was_chosen_when_they_were_asked_for(view: View):
    panel = ComparePanel(view, Companions())
    panel._show(view.made(0))
    panel._name.value, panel._against.value = STEREO, VELODYNE
    made = view.made

    def changing(index: int) -> Moment:
        panel._against.value = STEREO
        return made(index)

    view.made = changing  # type: ignore[method-assign]
    panel._every.ask(2)
    assert panel._every.idle(10)
    assert "different clouds" not in panel._told_all.content
    assert VELODYNE in panel._told_all.content
    assert not panel._stop.visible


def test_it_is_told_which_frames_belong_together(view: View):
    companions = Companions()
    panel = ComparePanel(view, companions)
    panel._show(view.made(0))
    assert not panel._paired.visible
    join(view, companions, Companion.of("run", Given(), Given()))
    panel._show(view.made(0))
    assert panel._paired.content == "run: 2 frames by their place"
    assert panel._paired.visible


def test_nothing_goes_on_where_a_frame_breaks(view: View, caplog: pytest.LogCaptureFixture):
    panel = ComparePanel(view, Companions())

    def odd(_index: int) -> Moment:
        assert panel._stop.visible
        raise ZeroDivisionError

    view.made = odd  # type: ignore[method-assign]
    panel._every.ask(2)
    assert panel._every.idle(10)
    assert "not done" in caplog.text
    assert not panel._stop.visible
    assert not panel._progress.visible
