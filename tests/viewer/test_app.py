"""The viewer of a rendered street in a real browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from playwright.sync_api import Frame as InnerPage
from pseudolidar.pipelines.convert import Convert, ConvertFrame, opened

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.measure import measured
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.box import Detection
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.comparing.pool import Pool
from pseudolidar.viewer.filming.film import Film
from pseudolidar.viewer.means import Means
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.reel import SourceReel
from tests.viewer.clients import wait_until
from tests.viewer.seen import page_within, pixels_of, screenshot

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
    job = Convert(Synthetic("street", frames=4, width_px=512))
    source = opened(job)
    sighted = SightFrame.of(
        MatchFrame.load(source, job.matcher, Refining(), SMALL_THINGS_KEPT), GroundFit()
    )
    reel = SourceReel(source, ConvertFrame.of(job, source).converted)
    with App.served(Address(port=0), Opened((reel,)), Means(sighted)) as served:
        yield served


@pytest.fixture(scope="module")
def opened_page(app: App, browser: Browser) -> Iterator[Page]:
    """One page for all: to draw without a GPU takes long."""
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    page = context.new_page()
    page.add_init_script(COUNT_SHADERS)
    page.goto(app.url)
    page.get_by_text(re.compile(r"\d / 4")).wait_for(timeout=60_000)
    yield page
    context.close()


def pictures(page: Page) -> InnerPage:
    inner = page_within(page, "Pictures")
    inner.wait_for_selector("nav button")
    return inner


def shown(page: Page, number: int) -> None:
    page.get_by_text(f"{number} / 4").wait_for(timeout=60_000)


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
    wait_until(lambda: app.view.stage.look("stereo").colouring.by == "height", patience_s=60)
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
    assert set(sizes.values()) == {(512, 155)}


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


def base(app: App) -> str:
    return app.url.split("?")[0]


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


def objects_page(page: Page) -> InnerPage:
    page.get_by_role("tab", name="Obstacles").click()
    return page_within(page, "Obstacles")


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
    share = 0.5 * (left + right) / 512, (0.3 * top + 0.7 * bottom) / 155
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
    wait_until(lambda: not app.view.stage.placement.holds, patience_s=60)


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


@pytest.mark.parametrize("key", ["", "track 99", "<b>", "x" * 3000])
def test_objects_that_are_none_are_not_chosen(app: App, opened_page: Page, key: str):
    answer = opened_page.request.get(f"{base(app)}obstacles/choose", params={"key": key})
    assert answer.ok
    assert answer.json()["chosen"] == ""
    assert opened_page.request.get(f"{base(app)}picture/choose", params={"key": key}).ok
    boxes = opened_page.request.get(f"{base(app)}picture/boxes", params={"kind": key})
    assert boxes.json()["chosen"] == ""


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
