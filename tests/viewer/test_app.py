"""The viewer of a rendered street in a real browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from pseudolidar.formats.points.ply import read_ply
from pseudolidar.obstacles.measure import measured
from pseudolidar.structures.box import Detection
from pseudolidar.viewer.app import App
from pseudolidar.viewer.comparing.pool import Pool
from pseudolidar.viewer.filming.film import Film
from pseudolidar.viewer.opening import Opened
from tests.viewer.clients import wait_until
from tests.viewer.seen import pixels_of, screenshot
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

# For a browser without a GPU to draw what it was sent, ms.
SETTLE_MS = 1000
# Counts in the page how many shaders were linked.
COUNT_SHADERS = """{
    const own = WebGL2RenderingContext.prototype, link = own.linkProgram;
    window.linked = 0;
    own.linkProgram = function (program) { window.linked++; return link.call(this, program); };
}"""


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    with served_street() as served:
        yield served


@pytest.fixture(scope="module")
def opened_page(app: App, browser: Browser) -> Iterator[Page]:
    """One page for all: to draw without a GPU takes long."""
    with page_of(app, browser, COUNT_SHADERS) as page:
        yield page


def test_a_frame_is_shown_with_its_points(app: App, opened_page: Page):
    assert app.view.moment is not None
    assert set(app.view.stage.shown) == {"stereo", "velodyne"}
    points = sum(map(len, app.view.moment.clouds.values()))
    opened_page.get_by_text(f"{points:,} points").wait_for(timeout=60_000)


def test_each_browser_has_a_scale_bar_on_the_ground(app: App, opened_page: Page):
    (number,) = app.view.server.viser.get_clients()
    wait_until(lambda: (ruler := app.ruler.of(number)) is not None and ruler.middle_m[2] < -1)
    ruler = app.ruler.of(number)
    assert ruler is not None
    assert ruler.length_m in (5, 10)
    assert app.ground.level_m == pytest.approx(-1.73, abs=0.04)


def test_it_steps_scrubs_and_plays(app: App, opened_page: Page):
    app.view.jump(0)
    shown(opened_page, 1)
    opened_page.get_by_text(">", exact=True).click()
    shown(opened_page, 2)
    opened_page.wait_for_timeout(SETTLE_MS)
    linked = opened_page.evaluate("linked")
    opened_page.keyboard.press("j")
    shown(opened_page, 1)
    opened_page.get_by_text("Play", exact=True).click()
    shown(opened_page, 3)
    app.view.play(playing=False)
    opened_page.wait_for_timeout(SETTLE_MS)
    assert opened_page.evaluate("linked") == linked > 0  # no shader is compiled for a frame


def test_colours_are_chosen(app: App, opened_page: Page):
    assert app.view.stage.look("stereo").colouring.by == "photo"
    opened_page.get_by_label("Colour").first.click()
    opened_page.get_by_role("option", name="height").first.click()
    wait_until(lambda: app.view.stage.look("stereo").colouring.by == "height")
    opened_page.get_by_text("Blue, red, m").nth(1).wait_for(timeout=60_000)


def test_points_show_their_error(app: App, opened_page: Page):
    opened_page.get_by_label("Colour").first.click()
    opened_page.get_by_role("option", name="error").first.click()
    opened_page.get_by_text("Too near, too far, m").first.wait_for(timeout=60_000)
    assert np.isfinite(app.view.stage.shown["stereo"].extra["error_m"]).sum() > 10_000


def test_errors_by_range_are_drawn(app: App, opened_page: Page):
    opened_page.get_by_role("tab", name="Compare").click()
    opened_page.get_by_label("Errors of the shown frame").click()
    opened_page.locator("svg[role=img]").first.wait_for(timeout=60_000)
    screenshot(opened_page, "compare")
    pool = Pool("stereo", "velodyne")
    assert app.view.moment is not None
    pool.add(app.view.moment, {})
    (figures,) = pool.told()
    opened_page.get_by_text(f"{figures.overall.n:,}", exact=True).wait_for(timeout=60_000)
    opened_page.get_by_label("Errors of the shown frame").click()
    opened_page.get_by_role("tab", name="Scene").click()


def test_a_pixel_tells_its_depth(app: App, opened_page: Page):
    inner = pictures(opened_page)
    inner.wait_for_selector("#picture").scroll_into_view_if_needed()
    box = inner.wait_for_selector("#picture").bounding_box()
    assert box is not None
    opened_page.mouse.move(box["x"] + box["width"] * 0.5, box["y"] + box["height"] * 0.9)
    said = inner.get_by_text(re.compile(r"depth [\d.]+ ±"))
    said.wait_for(timeout=60_000)
    found = re.search(
        r"pixel (\d+), (\d+)\ndisparity .*\ndepth ([\d.]+) ±", inner.inner_text("#said")
    )
    assert found is not None
    assert app.view.moment is not None
    assert app.view.moment.converted is not None
    depth = app.view.moment.converted.depth
    assert depth is not None
    column, row = int(found[1]), int(found[2])
    assert float(found[3]) == pytest.approx(float(depth.values[row, column]), abs=0.006)


def test_a_box_is_measured_as_the_library_does(app: App, opened_page: Page):
    app.view.jump(0)
    shown(opened_page, 1)
    inner = pictures(opened_page)
    sides = inner.wait_for_selector("#picture").bounding_box()
    assert sides is not None
    x, y, width, height = (sides[key] for key in ("x", "y", "width", "height"))
    opened_page.mouse.move(x + 0.62 * width, y + 0.55 * height)
    opened_page.mouse.down()
    opened_page.mouse.move(x + 0.80 * width, y + 0.80 * height, steps=3)
    with opened_page.expect_response(re.compile("/picture/measure")) as answered:
        opened_page.mouse.up()
    inner.get_by_text("distance").wait_for(timeout=60_000)
    query = dict(re.findall(r"(left|top|right|bottom)=([\d.]+)", answered.value.url))
    moment = app.view.moment
    assert moment is not None
    assert moment.converted is not None
    assert app.picture._sights is not None
    sight = app.picture._sights(moment.converted.frame).sight
    box = tuple(float(query[side]) for side in ("left", "top", "right", "bottom"))
    (obstacle,) = measured(sight, [Detection("thing", box)])  # type: ignore[arg-type]
    said = inner.inner_text("#said")
    assert said.startswith(
        f"distance {obstacle.distance_m:.2f} ± {obstacle.sigma_distance_m:.2f} m"
    )


def test_pictures_are_of_the_frame(app: App, opened_page: Page):
    inner = pictures(opened_page)
    names = inner.locator("#kinds button").all_inner_texts()
    assert names == ["left", "right", "disparity", "depth", "sigma", "error", "velodyne"]
    with opened_page.expect_response(re.compile("kind=disparity")) as answered:
        inner.get_by_text("disparity", exact=True).click()
    assert answered.value.ok
    sizes = {
        name: size_of(opened_page.request.get(f"{base(app)}picture/view?kind={name}").body())
        for name in names
    }
    assert set(sizes.values()) == {(WIDTH_PX, HEIGHT_PX)}


@pytest.mark.parametrize(
    "query",
    ["", "x=1", "x=nan&y=1", "x=1e999&y=2", "x=a&y=b", "x=-5&y=99999"],
)
def test_wrong_queries_get_an_answer(app: App, opened_page: Page, query: str):
    assert opened_page.request.get(f"{base(app)}picture/pixel?{query}").ok
    assert opened_page.request.get(f"{base(app)}picture/measure?{query}").ok
    assert opened_page.request.get(f"{base(app)}picture/view?kind=../../etc").status == 404


def test_it_is_seen_in_the_browser(opened_page: Page):
    opened_page.wait_for_timeout(1500)
    scene = pixels_of(screenshot(opened_page, "sequence"))[100:, :600].reshape(-1, 3)
    assert len(np.unique(scene // 32, axis=0)) > 30  # many colours: a street, not an empty page


def size_of(picture: bytes) -> tuple[int, int]:
    height, width = pixels_of(picture).shape[:2]
    return width, height


def test_a_click_tells_the_point_and_two_their_distance(app: App, opened_page: Page):
    app.view.jump(0)
    shown(opened_page, 1)
    stage = app.view.stage
    cloud, T = stage.pickable()["stereo"]
    eye = np.array([-3.0, 0.0, 1.0])
    near, far = (np.argmin(np.linalg.norm(cloud.xyz - place, axis=1)) for place in PLACES)
    for index in (near, far):
        place = T[:3, :3] @ cloud.xyz[index] + T[:3, 3]
        app.points.click(eye, place - eye)
    opened_page.get_by_text("apart").wait_for(timeout=60_000)
    assert app.view.marks._place.visible


def test_a_box_of_points_tells_how_flat_they_are(app: App, opened_page: Page):
    app.box._between()
    # Without waiting for a page that stands still: one that draws slowly hardly ever does.
    opened_page.get_by_role("tab", name="Points").click(force=True)
    opened_page.get_by_text("95 % within").wait_for(timeout=60_000)
    screenshot(opened_page, "box")
    told = app.box.figures["stereo"]
    row = opened_page.locator("tr", has_text="from it, RMS").inner_text()
    assert told.flatness is not None
    assert f"{1000 * told.flatness.rms_m:.1f} mm" in row
    assert told.flatness.expected_m is not None
    assert told.flatness.tilt_deg < 5  # a road
    app.box.put(None)


PLACES = ((8.0, 0.0, -1.6), (12.0, 1.0, -1.6))


def test_a_click_in_the_browser_arrives(app: App, opened_page: Page):
    app.points._text.content = "waiting"
    for _ in range(20):  # a page that is still drawing takes a click for a drag
        opened_page.mouse.click(300, 420)
        opened_page.wait_for_timeout(500)
        if app.points._text.content != "waiting":
            break
    opened_page.get_by_text("waiting").wait_for(state="detached", timeout=60_000)


def test_shown_clouds_are_taken_away(app: App, opened_page: Page, tmp_path: Path):
    moment = app.view.moment
    assert moment is not None
    answer = opened_page.request.get(f"{base(app)}export/cloud?name=stereo&kind=ply")
    (tmp_path / "a.ply").write_bytes(answer.body())
    assert len(read_ply(tmp_path / "a.ply")) == len(moment.clouds["stereo"])
    assert "000000_stereo.ply" in answer.headers["content-disposition"]
    for query in ("", "name=stereo", "name=nobody&kind=ply", "name=stereo&kind=../x"):
        assert opened_page.request.get(f"{base(app)}export/cloud?{query}").status == 404


def test_the_page_and_the_pages_in_it_are_dark_or_light(app: App, opened_page: Page):
    inner = (pictures(opened_page), objects_page(opened_page))
    opened_page.get_by_role("tab", name="Scene").click()
    folder = opened_page.get_by_text("Scene", exact=True).nth(1)
    folder.wait_for(timeout=60_000)
    dark = opened_page.get_by_label("Dark", exact=True)
    if not dark.is_visible():
        folder.click()
    grounds = dict[str, list[str]]()
    for scheme in ("light", "dark"):
        dark.click()
        opened_page.locator(f'html[data-mantine-color-scheme="{scheme}"]').wait_for(
            state="attached", timeout=60_000
        )
        light = "body.light" if scheme == "light" else "body:not(.light)"
        for one in inner:
            one.locator(light).wait_for(state="attached", timeout=60_000)
        grounds[scheme] = [
            one.evaluate("getComputedStyle(document.body).backgroundColor")
            for one in (opened_page, *inner)
        ]
        assert app.view.dark is (scheme == "dark")
        screenshot(opened_page, scheme)
    assert all(a != b for a, b in zip(grounds["light"], grounds["dark"], strict=True))


def test_a_browser_sends_its_own_view_and_a_film_is_made(app: App, opened_page: Page):
    opened_page.get_by_role("tab", name="Export").click()
    with opened_page.expect_download(timeout=60_000) as sent:
        opened_page.get_by_role("button", name="This view as PNG").click()
    picture = pixels_of(Path(sent.value.path()).read_bytes())
    assert sent.value.suggested_filename == "view.png"
    assert size_of_page(opened_page)[1] - picture.shape[0] < 10
    assert len(np.unique(picture.reshape(-1, 3) // 32, axis=0)) > 30
    app.export._maker._film = lambda: Film.of(  # a small one of the same
        Opened((app.view.reel,)), size_px=(64, 36)
    )
    opened_page.get_by_role("button", name="Film (MP4)").click()
    opened_page.get_by_text("film.mp4").wait_for(timeout=60_000)
    made = opened_page.request.get(f"{base(app)}export/film")
    assert made.body()[4:8] == b"ftyp"
    assert made.headers["content-type"] == "video/mp4"


def size_of_page(page: Page) -> tuple[int, int]:
    assert page.viewport_size is not None
    return page.viewport_size["width"], page.viewport_size["height"]
