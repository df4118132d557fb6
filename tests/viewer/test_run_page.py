"""A page on what a run makes: it shows the newest, and never holds the run up."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page
from pseudolidar.pipelines.convert import Convert
from pseudolidar.pipelines.convert import run as convert

from pseudolidar.errors import UsageError
from pseudolidar.formats.meshes.mesh_file import ENCODERS
from pseudolidar.running import lingering
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.drawn_path import segments_of
from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.run_page import NOBODY_S, PAUSE_S, SHARE, RunPage, run_page
from tests.viewer.test_meshes import roof

SOURCE = Synthetic("street", frames=3, width_px=128, height_px=64)


@dataclass(frozen=True)
class Asked:
    view: bool = True
    host: str = "127.0.0.1"
    port: int = 0


def moment(index: int) -> Moment:
    xyz = np.random.default_rng(index).uniform(-5, 5, (index + 1, 3)).astype(np.float32)
    T = np.eye(4)
    T[0, 3] = index
    return Moment(f"id{index}", index, clouds={"points": PointCloud(xyz, "map")}, T_map_forward=T)


@pytest.fixture
def onlooker() -> Iterator[RunPage[int]]:
    with run_page(Asked(), SOURCE.open(), moment) as page:
        assert page is not None
        yield page


def drawn_by(names: list[str], draw: Callable[..., None]) -> Callable[..., None]:
    """The same, and it is noted which thread does it."""

    def noted(what: object) -> None:
        names.append(threading.current_thread().name)
        draw(what)

    return noted


def until(true: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 60
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def test_nobody_looks_on_where_nobody_asked():
    with run_page(Asked(view=False), SOURCE.open(), moment) as page:
        assert page is None


def test_the_newest_is_shown_and_what_came_between_is_counted():
    shown: list[int] = []
    taking, go_on = threading.Event(), threading.Event()

    def slow(index: int) -> Moment:
        shown.append(index)
        taking.set()
        go_on.wait(60)
        return moment(index)

    with run_page(Asked(), SOURCE.open(), slow) as page:
        assert page is not None
        page.show(0, 0)
        taking.wait(60)
        for index in (2, 1, 4):  # nobody waits for the page
            page.show(index, index)
        go_on.set()
    assert shown == [0, 4]
    assert (page.given, page.passed_over) == (4, 2)


def test_a_frame_that_cannot_be_shown_ends_nothing(caplog: pytest.LogCaptureFixture):
    def faulty(index: int) -> Moment:
        raise ValueError("odd")

    with run_page(Asked(), SOURCE.open(), faulty) as page:
        assert page is not None
        page.show(0, 0)
    assert "cannot be shown" in caplog.text


def test_the_way_grows_and_a_map_is_laid_down(
    onlooker: RunPage[int], monkeypatch: pytest.MonkeyPatch
):
    view = onlooker._app.view
    drawing = list[str]()
    monkeypatch.setattr(view.stage, "put", drawn_by(drawing, view.stage.put))
    for index in range(3):
        onlooker.show(index, index)
        until(lambda number=index: view.moment is not None and view.moment.id == f"id{number}")
    line = onlooker._app.path._line
    until(lambda: len(line.points) == 2)
    assert np.allclose(line.points[:, :, 0], [[0, 1], [1, 2]])
    onlooker.lay("map", PointCloud(np.ones((4, 3), np.float32), "map"))
    onlooker.lay("none", None)
    until(lambda: "map" in onlooker._app.scene._folders)
    assert set(view.stage.stills) == {"map"}
    assert drawing == ["viewer"]


def test_a_mesh_is_laid_down_and_one_that_cannot_be_drawn_ends_nothing(
    onlooker: RunPage[int], tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    app, kept, torn = onlooker._app, tmp_path / "mesh.ply", tmp_path / "torn.ply"
    kept.write_bytes(ENCODERS["ply"](roof()))
    torn.write_bytes(kept.read_bytes()[:-5])
    other = tmp_path / "other.ply"
    other.write_bytes(kept.read_bytes())
    for path in (torn, None, other, kept):
        onlooker.lay_mesh(path)
    until(lambda: "mesh" in app.scene._folders)
    until(lambda: "mesh" in app.meshes._surfaces)
    assert set(app.meshes.points) == {"mesh", "other"}
    assert app.scene._surfaces.visible
    assert "torn.ply is not shown" in caplog.text


def test_a_page_tells_how_far_the_run_is_and_stays_where_it_is_told_to(
    onlooker: RunPage[int], page: Page
):
    page.goto(onlooker._app.url)
    page.get_by_text("The first frame is being made").wait_for(timeout=60_000)
    onlooker.show(0, 0)
    page.get_by_text("frame 1 of 3").wait_for(timeout=60_000)
    page.get_by_label("Stay at this frame").click()
    until(lambda: onlooker._reel.held)
    onlooker.show(1, 1)
    page.get_by_text("2 made").wait_for(timeout=60_000)
    assert page.get_by_text("frame 1 of 3").is_visible()
    page.get_by_label("Stay at this frame").click()
    page.get_by_text("frame 2 of 3").wait_for(timeout=60_000)
    onlooker.finish()
    page.get_by_text(re.compile("The run has ended")).wait_for(timeout=60_000)


def test_a_held_frame_gives_way_to_the_newest_of_all():
    reel = LiveReel("a run")
    assert reel.take(moment(0))
    reel.hold(held=True)
    assert not reel.take(moment(1))
    assert not reel.take(moment(2))
    assert reel.load(0).index == 0
    reel.hold(held=False)
    assert reel.load(0).index == 2


def test_a_page_takes_its_share_of_a_core(onlooker: RunPage[int], monkeypatch: pytest.MonkeyPatch):
    def slow(index: int) -> Moment:
        ends_s = time.thread_time() + 0.05
        while time.thread_time() < ends_s:
            pass
        return moment(index)

    onlooker._moment = slow
    viser = onlooker._app.view.server.viser
    assert onlooker._take(0) == NOBODY_S
    monkeypatch.setattr(viser, "get_clients", lambda: {0: None})
    assert onlooker._take(1) >= 0.05 / SHARE
    onlooker._moment = moment
    assert onlooker._take(2) >= PAUSE_S


@pytest.mark.parametrize(
    ("terminal", "endless", "stays"), [(True, False, 1), (False, False, 0), (True, True, 0)]
)
def test_at_a_terminal_a_page_stays_open_after_the_end(
    monkeypatch: pytest.MonkeyPatch, *, terminal: bool, endless: bool, stays: int
):
    waits: list[Callable[[], None]] = []
    monkeypatch.setattr(lingering, "_waits", waits)
    for stream in (sys.stdin, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: terminal)
    with run_page(Asked(), SOURCE.open(), moment, endless=endless) as page:
        assert page is not None
        assert not waits
    app = page._app
    assert len(waits) == stays
    assert app.view._ended.is_set() == (not stays)
    app._ended.set()  # as Ctrl-C does
    for wait in waits:
        wait()
    assert app.view._ended.is_set()


def test_places_are_in_the_order_of_frames():
    places = {3: np.float32([3, 0, 0]), 1: np.float32([1, 0, 0]), 2: np.float32([2, 0, 0])}
    assert segments_of(places)[:, :, 0].tolist() == [[1, 2], [2, 3]]
    assert segments_of({1: places[1]}).shape == (0, 2, 3)


def test_a_run_with_a_page_writes_the_same(tmp_path: Path):
    plain = Convert(replace(SOURCE, frames=1), tmp_path / "plain", Outputs(("pcd",)), check=False)
    seen = replace(plain, out=tmp_path / "seen", view=True, port=0)
    assert [convert(job).exit_code for job in (plain, seen)] == [0, 0]
    (file,) = (plain.out / "pcd").iterdir()
    assert file.read_bytes() == (seen.out / "pcd" / file.name).read_bytes()
    again = convert(replace(seen, view=False))
    assert again.result.passed_now == 0  # a page is no other settings


def test_what_other_processes_make_is_not_shown():
    with pytest.raises(UsageError, match="--isolate"):
        Convert(SOURCE, view=True, isolate=True)


def test_what_goes_on_is_waited_for_unless_a_signal_ended_the_run():
    waited: list[str] = []

    def pressed() -> None:
        waited.append("page")
        raise KeyboardInterrupt

    for exit_code in (0, 4, 130, 143):
        lingering.after_results(pressed)
        lingering.linger(exit_code)
    assert waited == ["page", "page"]
    lingering.linger(0)
    assert waited == ["page", "page"]
