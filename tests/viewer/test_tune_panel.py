"""The Tune tab of a rendered street in a real browser."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from pseudolidar.pipelines.view import View, workshop

from pseudolidar.cli import main
from pseudolidar.formats.pictures.disparity_png import read_disparity_png
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.means import Means
from pseudolidar.viewer.opening import Opened
from tests.viewer.seen import page_within, screenshot

SOURCE = Synthetic("street", frames=2, width_px=400)


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    job = View()
    reel = job.reel_of(SOURCE)
    shop = workshop(job, reel)
    with App.served(Address(port=0), Opened((reel,)), Means(reel.sighted, workshop=shop)) as served:
        yield served


@pytest.fixture(scope="module")
def opened_page(app: App, browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 900, "height": 1400})
    page = context.new_page()
    page.goto(app.url)
    page.get_by_role("tab", name="Tune").click()
    page.get_by_text("against ground truth").wait_for(timeout=60_000)
    yield page
    context.close()


def test_a_slider_changes_disparities_figures_and_the_saved_file(
    app: App, opened_page: Page, tmp_path: Path
):
    before = app.view.moment
    assert before is not None
    assert before.converted is not None
    opened_page.get_by_text("Keep as A").click()
    opened_page.get_by_text("A and B, one over the other").wait_for(timeout=60_000)
    opened_page.get_by_role("slider").nth(2).focus()  # uniqueness, after frame and penalty large
    opened_page.keyboard.press("End")
    opened_page.get_by_text(re.compile(r"^-\d+\.\d\d$")).first.wait_for(timeout=60_000)
    assert app.tune.tuner.idle(20)
    screenshot(opened_page, "tune")
    after = app.view.moment
    assert after is not None
    assert after.converted is not None
    assert after.converted.disparity is not None
    assert before.converted.disparity is not None
    assert after.converted.disparity.valid.sum() < before.converted.disparity.valid.sum()

    saved = tmp_path / "settings.json"
    with opened_page.expect_download() as download:
        opened_page.get_by_text("Save as settings.json").click()
    download.value.save_as(saved)
    assert json.loads(saved.read_bytes())["settings"]["matcher"]["uniqueness_percent"] == 25
    args = ["--source.frames", "2", "--source.width-px", "400", "--to", "disparity"]
    out = tmp_path / "out"
    assert main(["convert", "synthetic:street", str(out), *args, "--settings", str(saved)]) == 0
    written = read_disparity_png(out / "disparity" / "000000.png").values
    shown = after.converted.disparity.values
    assert np.array_equal(np.isnan(written), np.isnan(shown))
    assert np.nanmax(np.abs(written - shown)) <= 1 / 256


def test_undo_takes_the_controls_back(app: App, opened_page: Page):
    app.tune.choose(app.tune._bench.parts["matcher"], "bm")
    opened_page.get_by_text("texture", exact=True).wait_for(timeout=60_000)
    opened_page.get_by_text("Undo").click()
    opened_page.get_by_text("texture", exact=True).wait_for(state="hidden", timeout=60_000)
    assert app.tune.tuner.idle(20)


def test_a_click_on_a_thing_tells_its_width_and_distance(app: App, opened_page: Page):
    opened_page.get_by_text("Colour detector").click()
    opened_page.get_by_label("Pick by a click").check()
    inner = page_within(opened_page, "Pictures")
    sides = inner.wait_for_selector("#picture").bounding_box()
    assert sides is not None
    x, y = coloured_place(app)
    opened_page.mouse.click(
        sides["x"] + (x + 0.5) / 400 * sides["width"],
        sides["y"] + (y + 0.5) * sides["width"] / 400,
    )
    opened_page.get_by_text(re.compile(r"m wide, [\d.]+ ± [\d.]+ m away")).wait_for(timeout=60_000)
    opened_page.get_by_text(re.compile("^--detector colour:")).wait_for(timeout=60_000)
    inner.get_by_text("colour", exact=True).wait_for(timeout=60_000)


def coloured_place(app: App) -> tuple[int, int]:
    """The middle of the most saturated part of the left picture."""
    import cv2

    moment = app.view.moment
    assert moment is not None
    assert moment.converted is not None
    hsv = cv2.cvtColor(moment.converted.frame.left, cv2.COLOR_RGB2HSV)  # type: ignore[union-attr]
    saturated = cv2.blur(np.minimum(hsv[..., 1], hsv[..., 2]), (9, 9))
    row, column = np.unravel_index(np.argmax(saturated), saturated.shape)
    return int(column), int(row)
