"""Data that was made to do harm: names that are pages, points that are nowhere, far too many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from pseudolidar.formats.points.ply import write_ply
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.opening import Opened, Opening
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.server import GuardedServer
from pseudolidar.viewer.stage import MOST_POINTS, STILL_LOOK, Stage
from pseudolidar.viewer.stills import StillCloud

# Each would set `harmed` in the page if it were taken for what it says.
HARM = "<img src=x onerror=top.harmed=1>"
NAMES = (
    HARM,
    f"`{HARM}",
    f"**{HARM}",
    f"&lt;b&gt;{HARM}",
    "![x](x onerror=top.harmed=1)",
    "[x](javascript:top.harmed=1)",
    "'\"><svg onload=top.harmed=1>",
    "${top.harmed=1}{top.harmed=1}",
    f"<iframe srcdoc='{HARM}'>",
    "\n\n# a title\n",
)


@dataclass(frozen=True)
class HostileReel:
    """Frames whose ids, faults and columns are pages."""

    name: str = HARM
    ids: Sequence[str] = NAMES
    times_s: Sequence[float] = tuple(map(float, range(len(NAMES))))

    def load(self, index: int) -> Moment:
        points = np.float32([[5, 0, 0], [6, 1, 0], [7, -1, 1]])
        cloud = PointCloud(points, "base_link", extra={HARM: np.float32([1, 2, 3])})
        return Moment(NAMES[index], index, clouds={HARM: cloud}, fault=f"no <b>: {NAMES[index]}")


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    folder = tmp_path_factory.mktemp("hostile")
    for name in NAMES:
        write_ply(folder / f"{name.replace('/', '')}.ply", PointCloud(np.eye(3), "map"))
    write_ply(folder / "\udcff\udcfe.ply", PointCloud(np.eye(3), "map"))  # bytes of no text
    files = Opening(lambda _source: NoFrames()).all_of([str(file) for file in folder.iterdir()])
    with App.served(Address(port=0), Opened((HostileReel(),), files.stills)) as served:
        yield served


def test_names_are_shown_as_they_are_and_do_nothing(app: App, browser: Browser):
    context = browser.new_context(viewport={"width": 1000, "height": 2000})
    page = context.new_page()
    page.goto(app.url)
    page.get_by_text(f"1 / {len(NAMES)}").wait_for(timeout=60_000)
    for index, tab in enumerate(("Compare", "Export", "Help", "Scene")):
        page.get_by_role("tab", name=tab).click()
        app.view.jump(index + 1)
        page.get_by_text(f"{index + 2} / {len(NAMES)}").wait_for(timeout=60_000)
    app.points.click(np.zeros(3), np.array([5.0, 0.0, 0.0]))
    page.get_by_text("range").first.wait_for(timeout=60_000)
    assert page.get_by_text(HARM).count() >= 3
    assert page.evaluate("window.harmed") is None
    assert page.locator("img[src=x], svg[onload], iframe[srcdoc]").count() == 0
    assert page.get_by_role("heading", name="a title").count() == 0
    context.close()


@pytest.mark.parametrize("name", NAMES)
def test_no_mark_of_markdown_or_html_is_left(name: str):
    text = escaped(name)
    assert "<" not in text
    assert "\n" not in text
    for mark in "`*_[]{}#!|":
        assert all(
            before == "\\" for before, this in zip(" " + text, text, strict=False) if this == mark
        )


def hostile_cloud(count: int) -> PointCloud:
    """Points of which every tenth is nowhere."""
    xyz = np.random.default_rng(3).uniform(-90, 90, (count, 3)).astype(np.float32)
    bad = np.float32([np.nan, np.inf, -np.inf, 3e38, 1e12])
    xyz[::10, 1] = np.resize(bad, len(xyz[::10]))
    rgb = np.zeros((count, 3), np.uint8)
    return PointCloud(xyz, "base_link", rgb=rgb)


def test_points_that_are_nowhere_are_not_drawn_and_the_rest_is_thinned(server: GuardedServer):
    cloud, stage = hostile_cloud(400_000), Stage(server.viser)
    frame = RecordedCloud(cloud, "a", 0, 0)
    moment = Moment.of(Converted(frame, cloud))
    assert len(moment.clouds["points"]) == 360_000
    stage.show(moment)
    drawn = stage._clouds["points"].points
    assert drawn.dtype == np.float32  # as float16 a point at 80.03 m would lie at 80.00 m
    assert len(drawn) == MOST_POINTS
    assert np.abs(drawn).max() <= 90
    assert {tuple(place) for place in drawn[:100]} <= {tuple(place) for place in cloud.xyz}


def test_five_million_points_are_thinned(server: GuardedServer):
    xyz = np.random.default_rng(3).uniform(-90, 90, (5_000_000, 3)).astype(np.float32)
    stage = Stage(server.viser)
    stage.put(StillCloud("map.ply", PointCloud(xyz, "map")))
    assert len(stage._clouds["map.ply"].points) == STILL_LOOK.most_points == 2_000_000


def test_a_file_of_points_that_are_nowhere(tmp_path: Path):
    write_ply(tmp_path / "a.ply", hostile_cloud(1000))
    (still,) = Opening(lambda _source: NoFrames()).all_of([str(tmp_path / "a.ply")]).stills
    assert isinstance(still, StillCloud)
    assert len(still.cloud) == 900
    write_ply(tmp_path / "none.ply", PointCloud(np.full((5, 3), np.nan), "map"))
    (still,) = Opening(lambda _source: NoFrames()).all_of([str(tmp_path / "none.ply")]).stills
    assert isinstance(still, StillCloud)
    assert len(still.cloud) == 0
