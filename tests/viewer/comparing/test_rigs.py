"""The rig refined on what is looked at, and the frames by both rigs in one scene."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from pseudolidar.pipelines.view import View as ViewJob
from pseudolidar.pipelines.view import rig_shop

from pseudolidar.errors import ReferenceMissing
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.pipelines import view as view_pipeline
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.camera import StereoRig
from pseudolidar.viewer.comparing.companions import Companions
from pseudolidar.viewer.comparing.pool import Pool
from pseudolidar.viewer.comparing.rigs import MOST_FRAMES, Fit, RigShop, Seeing, some_frames
from pseudolidar.viewer.moment import STEREO, VELODYNE, Moment
from pseudolidar.viewer.panels.rig import REFINED, STOCK, RigPanel
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.server import GuardedServer
from pseudolidar.viewer.view import View

STREET = Synthetic("street", frames=3, width_px=240)
# How far the right eye's centre is off, px.
OFF_PX = 0.8


def median_error(reel: Reel) -> float:
    pool = Pool(STEREO, VELODYNE)
    pool.add(reel.load(0), {})
    (told,) = pool.told()
    assert told.overall.median is not None
    return told.overall.median


def test_frames_by_a_refined_rig_are_where_the_scan_is(tmp_path: Path):
    rig = STREET.open().rig
    K = rig.right.K.copy()
    K[0, 2] += OFF_PX
    write_rig(tmp_path / "wrong.json", replace(rig, right=replace(rig.right, K=K)))
    job = ViewJob(rig=tmp_path / "wrong.json")
    wrong = job.reel_of(STREET)
    shop = rig_shop(job, wrong)
    assert shop.given
    seen: list[int] = []
    found = shop.refined(seen.append)
    assert seen == [3, 3, 3]
    assert found.reel is not None
    assert median_error(wrong) > 0.07  # 0.8 px of the 10 px that most points have
    assert median_error(found.reel) < 0.03
    assert median_error(shop.by_rig(None)) < 0.03
    (tmp_path / "rig.json").write_bytes(found.file)
    assert read_rig(tmp_path / "rig.json").correction is not None
    assert any("3 frames" in line for line in found.lines)


def test_memory_is_given_back_after_a_fit_that_fails(monkeypatch: pytest.MonkeyPatch):
    given_back: list[None] = []

    def fitted(*_: object) -> None:
        raise ReferenceMissing("no fit", want="one")

    monkeypatch.setattr(view_pipeline, "fitted", fitted)
    monkeypatch.setattr(view_pipeline, "give_back_freed_memory", lambda: given_back.append(None))
    job = ViewJob()
    shop = rig_shop(job, job.reel_of(STREET))
    with pytest.raises(ReferenceMissing):
        shop.refined(lambda _count: None)
    assert given_back


def test_a_rig_is_fitted_to_some_frames_of_all_of_them():
    source = replace(STREET, frames=100).open()
    chosen = some_frames(source, lambda _frames: None)
    assert list(chosen.ids) == list(source.ids)[::3]
    assert len(chosen.ids) <= MOST_FRAMES
    few = replace(STREET, frames=MOST_FRAMES).open()
    assert list(some_frames(few, lambda _frames: None).ids) == list(few.ids)


@dataclass(frozen=True)
class Given:
    """A reel of one frame without clouds."""

    name: str = "given"
    ids: tuple[str, ...] = ("a",)
    times_s: tuple[float, ...] = (0.0,)

    def load(self, index: int) -> Moment:
        return Moment("a", index)


@dataclass
class Fits:
    """A fit that waits until it is let go, and sees two frames."""

    rig: StereoRig | None
    begun: threading.Event = field(default_factory=threading.Event)
    go: threading.Event = field(default_factory=threading.Event)
    count: int = 0

    def __call__(self, seen: Seeing) -> Fit:
        self.count += 1
        self.begun.set()
        assert self.go.wait(60)
        seen(2)
        seen(2)
        return Fit(self.rig, ("fitted",))


@dataclass
class Bench:
    """A panel with what it works on."""

    panel: RigPanel
    fits: Fits
    companions: Companions
    view: View

    def state(self) -> tuple[bool, bool, bool]:
        """Whether Stop is there, and whether each of the two buttons is out of use."""
        panel = self.panel
        return panel._stop.visible, panel._refine.disabled, panel._stock.disabled

    def done(self) -> list[str]:
        assert self.panel._work.idle(10)
        assert self.state() == (False, False, False)
        return [one.label for one in self.companions.every]


@pytest.fixture
def bench(server: GuardedServer) -> Iterator[Bench]:
    view, companions, fits = View(server, Given()), Companions(), Fits(STREET.open().rig)
    shop = RigShop(lambda _rig: Given(), fits, given=True)
    yield Bench(RigPanel(view, companions, shop), fits, companions, view)
    fits.go.set()
    view.stop()


def test_a_click_is_seen_at_once_and_a_second_one_is_none(bench: Bench):
    bench.panel._ask(REFINED)
    assert bench.state() == (True, True, True)
    bench.panel._ask(REFINED)
    bench.panel._ask(STOCK)
    bench.fits.go.set()
    assert bench.done() == [REFINED]
    assert bench.fits.count == 1
    assert bench.panel._progress.value == 100
    assert bench.panel._text.content == "fitted"
    assert bench.panel._save.visible
    answer = bench.view.server.pages["/compare/rig"]({})
    assert b"baseline_m" in answer.body
    bench.panel._ask(STOCK)
    assert bench.state() == (True, True, True)
    assert bench.done() == [REFINED, STOCK]


def test_stop_ends_a_fit_that_has_hardly_begun(bench: Bench):
    bench.panel._ask(REFINED)
    bench.panel._end()
    bench.fits.go.set()
    assert bench.done() == []
    assert bench.panel._text.content == escaped("Stopped.")
    bench.panel._ask(REFINED)
    assert bench.done() == [REFINED]


def test_the_end_of_the_viewer_ends_a_fit(bench: Bench):
    bench.panel._ask(REFINED)
    assert bench.fits.begun.wait(60)
    closing = threading.Thread(target=bench.panel._work.close)
    closing.start()
    while not bench.panel._overtaken():
        closing.join(0.01)
    bench.fits.go.set()
    closing.join()
    assert bench.done() == []


def test_what_hinders_is_told_and_a_good_rig_stays(bench: Bench):
    bench.fits.go.set()
    bench.fits.rig = None
    bench.panel._ask(REFINED)
    assert bench.done() == []
    assert bench.panel._text.content == "fitted"
    assert not bench.panel._save.visible

    def missing(_seen: Seeing) -> Fit:
        raise ReferenceMissing("no frame has a scan", want="one")

    bench.panel._shop = replace(bench.panel._shop, fit=missing)
    bench.panel._ask(REFINED)
    assert bench.done() == []
    assert "no frame has a scan" in bench.panel._text.content
