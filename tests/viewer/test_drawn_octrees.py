"""Large clouds in a real browser, and for browsers that take nothing."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.drawn_octrees import MOST_WAITING, Looker
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.picking import picked
from pseudolidar.viewer.stills import SHARED_POINTS, StillOctree
from tests.viewer.seen import screenshot

COUNT = 700_000
NAME, DENSE = "map.ply", "dense.ply"
UTM_M = np.array([4.5e5, 5.4e6, 110.0])


def town() -> PointCloud:
    rng = np.random.default_rng(5)
    xyz = UTM_M + rng.uniform((-90, -90, 0), (90, 90, 1), (COUNT, 3))
    return PointCloud(xyz, "map", rgb=rng.integers(0, 255, (COUNT, 3), dtype=np.uint8))


def dense() -> PointCloud:
    """3 m of a street, and a point 50 m away."""
    xyz = UTM_M + np.random.default_rng(6).uniform((0, 0, 0), (3, 3, 1), (60_000, 3))
    xyz[41_000] += 50.017
    return PointCloud(xyz, "map")


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    with App.served(Address(port=0), Opened((), (StillOctree(NAME, built(town())),))) as served:
        yield served


@pytest.fixture(scope="module")
def opened_page(app: App, browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 700, "height": 400})
    page = context.new_page()
    page.goto(app.url)
    page.get_by_text("Millions drawn").wait_for(timeout=60_000)
    yield page
    context.close()


def until(true: Callable[[], bool]) -> None:
    ends = time.monotonic() + 60
    while not true():
        assert time.monotonic() < ends
        time.sleep(0.02)


def looker(app: App) -> Looker:
    until(lambda: bool(app.octrees.lookers))
    return next(iter(app.octrees.lookers.values()))


def numbers_shown(app: App) -> set[int]:
    return {number for (_, number), handle in list(looker(app).has.items()) if handle.visible}


def test_all_browsers_draw_the_coarsest_points(app: App):
    (shared,) = app.view.stage.stills.values()
    assert 0 < len(shared) <= SHARED_POINTS
    assert np.ptp(shared.xyz[:, 0]) > 170


def test_a_browser_draws_more_where_it_looks(app: App, opened_page: Page):
    client = looker(app).client
    for x in (-80.0, 80.0):
        client.camera.position = (x, 0.0, 12.0)
        client.camera.look_at = (x, 2.0, 0.0)
        until(partial(settled, app, x))
    # Both places are kept, one of them out of sight.
    assert len(looker(app).has) > len(numbers_shown(app))


def settled(app: App, x: float) -> bool:
    tree, shown = app.octrees._trees[NAME], numbers_shown(app)
    deepest = tree.nodes["level"].max()
    fine = [n for n in shown if tree.nodes["level"][n] == deepest]
    places = tree.boxes_m[0][fine][:, 0] - 4.5e5
    return bool(fine) and bool((np.sign(places) == np.sign(x)).all())


def draws(app: App, *, something: bool) -> bool:
    return bool(numbers_shown(app)) == something


def test_fine_points_have_the_colours_of_coarse_ones(app: App, opened_page: Page):
    before = app.view.stage.look(NAME)
    app.view.stage.looks[NAME] = type(before)(Colouring("height"), before.point_m)
    app.view.redraw()
    until(lambda: app.view.stage.look(NAME).colouring.low is not None)
    (shared,) = app.view.stage.stills.values()
    colouring = app.view.stage.look(NAME).colouring
    assert colouring.settled(shared) == colouring
    tree = app.octrees._trees[NAME]

    def recoloured() -> bool:
        handles = list(looker(app).has.items())
        return all(
            np.array_equal(handle.colors, colouring.colours(tree.cloud([number])))
            for (_, number), handle in handles
        )

    until(recoloured)


def test_what_is_not_shown_is_not_drawn(app: App, opened_page: Page):
    before = app.view.stage.look(NAME)
    for visible in (False, True):
        app.view.stage.looks[NAME] = type(before)(before.colouring, before.point_m, visible=visible)
        app.view.redraw()
        until(partial(draws, app, something=visible))


def test_fewer_points_are_drawn_where_fewer_are_wanted(app: App, opened_page: Page):
    (shared,) = app.view.stage.stills.values()
    app.octrees.budget = len(shared) + 60_000
    app.octrees.wake()
    number = looker(app).client.client_id
    until(lambda: app.octrees.drawn_points(number) <= 60_000)
    app.octrees.budget = 2_000_000
    app.octrees.wake()
    until(lambda: app.octrees.drawn_points(number) > 60_000)


def test_a_click_tells_a_fine_point_of_the_file(app: App, opened_page: Page):
    tree = app.octrees._trees[NAME]
    every = tree.cloud(range(len(tree.nodes)))
    T = app.view.stage.placement.T_scene_map
    eye = np.array([3.0, 7.0, 4.0])
    direction = T[:3, :3] @ every.xyz[-1] + T[:3, 3] - eye  # of the finest nodes
    want = picked({NAME: (every, T)}, eye, direction)
    assert want is not None
    app.points.click(eye, direction)
    x, y = want.xyz_m[:2]
    opened_page.get_by_text(f"{x:.2f}, {y:.2f}, ").wait_for(timeout=60_000)


def test_what_is_seen_is_downloaded(app: App, opened_page: Page, tmp_path: Path):
    opened_page.get_by_role("tab", name="Export").click()
    opened_page.get_by_text(f"all {COUNT:,} points").wait_for(timeout=60_000)
    with opened_page.expect_download(timeout=60_000) as sent:
        opened_page.get_by_role("button", name="PCD").click()
    sent.value.save_as(tmp_path / "seen.pcd")
    seen = read_pcd(tmp_path / "seen.pcd")
    assert 0 < len(seen) < COUNT
    opened_page.get_by_text(f"Sent: {NAME}, {len(seen):,} points").wait_for(timeout=60_000)
    screenshot(opened_page, "large_export")
    opened_page.get_by_role("tab", name="Scene").click()


def test_figures_and_files_are_not_made_of_the_coarsest_points(app: App):
    assert not app.view.stage.whole_stills


def test_a_browser_that_takes_nothing_is_sent_nothing(app: App):
    buffer = SimpleNamespace(message_from_id=dict.fromkeys(range(MOST_WAITING + 1)))
    connection = SimpleNamespace(get_message_buffer=lambda: buffer)
    stalled = Looker(SimpleNamespace(_websock_connection=connection))  # type: ignore[arg-type]
    assert app.octrees._draw(stalled)
    assert not stalled.has


@pytest.fixture(scope="module")
def both() -> Iterator[App]:
    stills = (StillOctree(NAME, built(town())), StillOctree(DENSE, built(dense())))
    with App.served(Address(port=0), Opened((), stills)) as served:
        yield served


def blind(app: App, x: float = 0.0, y: float = 0.0) -> Looker:
    """What a browser has that looks down on a place and draws nothing."""
    camera = SimpleNamespace(
        wxyz=(0.0, 1.0, 0.0, 0.0),
        position=(x, y, 12.0),
        fov=1.3,
        image_width=700,
        image_height=400,
    )
    connection = SimpleNamespace(get_message_buffer=lambda: SimpleNamespace(message_from_id={}))
    scene = app.octrees._server.scene
    client = SimpleNamespace(camera=camera, scene=scene, _websock_connection=connection)
    return Looker(client)  # type: ignore[arg-type]


def test_what_is_sent_lies_within_half_a_millimetre_of_the_file(both: App):
    looker, sent = blind(both), set()
    for name, tree in both.octrees._trees.items():
        for number in range(len(tree.nodes)):
            handle = both.octrees._add(looker.client, (name, number), 0.1)
            drawn = handle.points.astype(np.float64) + handle.position
            want = tree.cloud([number]).xyz - both.view.stage.placement.origin_m
            # Half of the last place of float16 below 2 m is 0.49 mm.
            assert np.abs(drawn - want).max() < 5e-4
            sent.add((name, handle.points.dtype.name))
    assert sent == {(NAME, "float32"), (DENSE, "float16"), (DENSE, "float32")}


def test_a_browser_does_not_hold_all_that_it_has_seen(both: App):
    octrees = both.octrees
    octrees.budget = sum(map(len, both.view.stage.stills.values())) + 60_000
    most = 1.25 * octrees.budget
    looker, seen = blind(both), set()
    for x, y in itertools.product((-60.0, 0.0, 60.0), repeat=2):
        looker.client.camera.position = (x, y, 30.0)
        while octrees._draw(looker):
            pass
        assert sum(map(octrees._count, looker.has)) <= most
        seen |= looker.has.keys()
    assert sum(map(octrees._count, seen)) > 1.2 * most
