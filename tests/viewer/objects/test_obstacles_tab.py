"""The tab of obstacles in a real browser: its list, its boxes in the picture, what is chosen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from playwright.sync_api import Frame as InnerPage

from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.measure import measured
from pseudolidar.viewer.app import App
from tests.viewer.clients import wait_until
from tests.viewer.seen import screenshot
from tests.viewer.street_app import (
    HEIGHT_PX,
    WIDTH_PX,
    base,
    objects_page,
    page_of,
    pictures,
    served_street,
    shown,
)


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    with served_street() as served:
        yield served


@pytest.fixture(scope="module")
def opened_page(app: App, browser: Browser) -> Iterator[Page]:
    """One page for all: to draw without a GPU takes long."""
    with page_of(app, browser) as page:
        yield page


def labels_page(app: App, page: Page) -> InnerPage:
    """The list of what is labelled in the first frame."""
    app.view.jump(0)
    shown(page, 1)
    inner = objects_page(page)
    page.get_by_label("Detector").click()
    page.get_by_role("option", name="labels").click()
    inner.locator("tbody tr").first.wait_for(timeout=60_000)
    return inner


def test_objects_are_listed_as_the_library_measures_them(app: App, opened_page: Page):
    inner = labels_page(app, opened_page)
    moment = app.view.moment
    assert moment is not None
    assert moment.converted is not None
    assert app.picture._sights is not None
    sight = app.picture._sights(moment.converted.frame).sight
    found = sorted(measured(sight, Labels().load()(sight)), key=lambda one: one.distance_m)
    rows = inner.locator("tbody tr").all_inner_texts()
    assert len(rows) == len(found)
    assert f"{found[0].distance_m:.1f} ± {found[0].sigma_distance_m:.1f}" in rows[0]
    assert rows[0].startswith(found[0].detection.name)
    screenshot(opened_page, "obstacles")


def test_a_box_in_the_picture_chooses_its_object(app: App, opened_page: Page):
    """And tells what is in it; boxes can be switched off."""
    listed, inner = labels_page(app, opened_page), pictures(opened_page)
    inner.get_by_text("left", exact=True).click()
    lines = inner.locator("#boxes polyline")
    objects = app.obstacles.scene.objects
    lines.nth(len(objects) + len(app.obstacles.scene.truths) - 1).wait_for(
        state="attached", timeout=60_000
    )
    sides = inner.wait_for_selector("#picture").bounding_box()
    assert sides is not None
    left, top, right, bottom = objects[0].obstacle.detection.box_px
    share = 0.5 * (left + right) / WIDTH_PX, (0.3 * top + 0.7 * bottom) / HEIGHT_PX
    at = sides["x"] + share[0] * sides["width"], sides["y"] + share[1] * sides["height"]
    opened_page.mouse.move(*at)
    inner.get_by_text(f"{objects[0].name}, {objects[0].distance}").wait_for(timeout=60_000)
    opened_page.mouse.click(*at)
    row = listed.locator('tbody tr[aria-selected="true"]')
    row.wait_for(timeout=60_000)
    assert row.inner_text().startswith(objects[0].name)
    assert app.obstacles.scene.chosen == objects[0].key
    inner.locator("#boxes .chosen").first.wait_for(state="attached", timeout=60_000)
    inner.get_by_role("button", name="3D").click()
    screenshot(opened_page, "boxes_in_picture")
    for switch in ("boxes", "3D"):
        inner.get_by_role("button", name=switch).click()
    assert not lines.count()
    assert not inner.locator("#boxes text").count()
    inner.get_by_role("button", name="boxes").click()
    row.click()
    row.wait_for(state="detached", timeout=60_000)


def test_a_chosen_object_stays_in_place(app: App, opened_page: Page):
    inner = objects_page(opened_page)
    inner.locator("tbody tr").nth(1).click()
    inner.locator('tbody tr[aria-selected="true"]').wait_for(timeout=60_000)
    chosen = app.obstacles.scene.chosen_one
    assert chosen is not None
    before = app.view.stage.placement.of_rig(chosen.middle_m)
    for _ in range(1200):  # drawn with the next tick
        if app.view.stage.placement.holds:
            break
        opened_page.wait_for_timeout(50)
    app.view.step(1)
    shown(opened_page, 2)
    for _ in range(1200):
        now = app.obstacles.scene.chosen_one
        if now is not None and np.linalg.norm(now.middle_m - chosen.middle_m) > 0.05:
            break
        opened_page.wait_for_timeout(50)
    assert now is not None
    assert now.key == chosen.key
    assert np.allclose(app.view.stage.placement.of_rig(now.middle_m), before, atol=1e-6)
    opened_page.get_by_label("Hold the chosen").click()
    wait_until(lambda: not app.view.stage.placement.holds)


@pytest.mark.parametrize("key", ["", "track 99", "<b>", "x" * 3000])
def test_objects_that_are_none_are_not_chosen(app: App, opened_page: Page, key: str):
    answer = opened_page.request.get(f"{base(app)}obstacles/choose", params={"key": key})
    assert answer.ok
    assert answer.json()["chosen"] == ""
    assert opened_page.request.get(f"{base(app)}picture/choose", params={"key": key}).ok
    boxes = opened_page.request.get(f"{base(app)}picture/boxes", params={"kind": key})
    assert boxes.json()["chosen"] == ""
