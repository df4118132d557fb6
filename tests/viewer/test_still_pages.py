"""Pages of maps, of nothing, and scenes that are files, in a real browser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from playwright.sync_api import Page

from pseudolidar.cli import main
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.opening import Opened, Opening
from pseudolidar.viewer.reel import NoFrames
from tests.viewer.seen import pixels_of, screenshot


def test_a_map_and_its_path_lie_still(tmp_path: Path, page: Page):
    rng = np.random.default_rng(0)
    far = np.array([4.5e5, 5.4e6, 100.0])
    points = far + rng.uniform((-20, -20, 0), (20, 20, 5), (5000, 3))
    rgb = rng.integers(0, 255, (5000, 3)).astype(np.uint8)
    write_ply(tmp_path / "utm.ply", PointCloud(points, "map", rgb=rgb))
    opened = Opening(lambda _source: NoFrames()).all_of([str(tmp_path / "utm.ply")])
    with App.served(Address(port=0), opened) as served:
        page.goto(served.url)
        page.get_by_text("utm.ply", exact=True).wait_for(timeout=60_000)
        page.wait_for_timeout(1000)
        scene = pixels_of(screenshot(page, "map"))[100:, :800].reshape(-1, 3)
    assert len(np.unique(scene // 32, axis=0)) > 30
    drawn = served.view.stage._clouds["utm.ply"].points
    assert np.abs(drawn).max() < 40
    assert np.allclose(drawn - drawn[0], (points - points[0]).astype(np.float32), atol=1e-4)


def test_an_empty_viewer_says_what_to_do(page: Page):
    with App.served(Address(port=0), Opened()) as served:
        page.goto(served.url)
        page.get_by_text("Nothing is open.").wait_for(timeout=60_000)


def test_a_scene_is_a_page_of_its_own(tmp_path: Path, page: Page):
    write_ply(tmp_path / "a.ply", PointCloud(np.eye(3, dtype=np.float32) * 5, "map"))
    out = tmp_path / "scene.html"
    assert main(["view", str(tmp_path / "a.ply"), "--export", str(out)]) == 0
    page.goto(out.as_uri())
    page.wait_for_selector("canvas", timeout=60_000)
    assert main(["view", "--export", str(tmp_path / "scene.txt")]) == 2
