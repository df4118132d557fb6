"""The box of points in an app, without a browser."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pseudolidar.formats.points.pcd import decode_pcd
from pseudolidar.structures.box import Box3D
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose
from pseudolidar.viewer import drawn_octrees
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.boxes.figures import BoxFigures
from pseudolidar.viewer.boxes.gathered import Gatherer
from pseudolidar.viewer.boxes.region import Region
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.drawn_region import FARTHEST_M
from pseudolidar.viewer.moment import Moment, Sight
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.panels import points
from pseudolidar.viewer.panels.box import BoxPanel
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.stills import StillCloud, StillOctree
from tests.viewer.clients import wait_until
from tests.viewer.test_filming import Frames

UTM = np.array([450_000.0, 5_400_000.0, 100.0])


def ground(count: int = 5000) -> PointCloud:
    rng = np.random.default_rng(0)
    xyz = UTM + rng.uniform((0, -5, 0), (20, 5, 0), (count, 3))
    return PointCloud(xyz, "map", intensity=rng.random(count).astype(np.float32))


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    stills = (StillCloud("a.ply", ground()), StillOctree("b.ply", built(ground(400_000))))
    with App.made(Address(port=0), Opened(stills=stills)) as made:
        yield made


@pytest.fixture
def box(app: App) -> Iterator[BoxPanel]:
    yield app.box
    app.box.put(None)


def settled(box: BoxPanel) -> BoxPanel:
    assert box._work.idle(10)
    return box


def click(app: App, x: float, y: float) -> None:
    """On a place of the ground, from above."""
    at = UTM + np.array([x, y, 0]) - app.view.stage.placement.origin_m
    app.points.click(at + np.array([0, 0, 8.0]), np.array([0, 0, -1.0]))


def test_a_box_about_a_click_tells_of_all_points_there(app: App, box: BoxPanel):
    here, between = box._buttons
    click(app, 10, 1)
    assert not here.disabled
    box._here()
    told = settled(box).figures
    assert set(told) == {"a.ply", "b.ply"}
    # 2 m x 2 m of 20 m x 10 m; of the large cloud all points, not the drawn ones.
    assert len(told["b.ply"].points) == pytest.approx(400_000 / 50, rel=0.05)
    assert told["b.ply"].middle_m == pytest.approx(UTM + np.array([10, 1, 0]), abs=0.1)
    for one in told.values():
        assert one.flatness is not None
        assert one.flatness.tilt_deg < 0.01
        assert one.flatness.rms_m < 1e-3
    assert "b.ply" in box._text.content
    assert box._drawn._frame.visible
    assert np.abs(box._drawn._frame.position).max() < 20  # not UTM
    click(app, 14, 3)
    assert not between.disabled
    box._between()
    told = settled(box).figures
    assert told["b.ply"].along_m == pytest.approx((4.4, 2.4, 0), abs=0.05)
    assert box._size.value == pytest.approx((4.4, 2.4, 0.4), abs=0.1)


def test_sizes_turns_and_handles_change_it(app: App, box: BoxPanel):
    click(app, 10, 0)
    box._here()
    set_value(box._size, (4.0, 1.0, 1.0))
    wait_until(lambda: box.region is not None and box.region.size_m[0] == 4)
    set_value(box._turn, 90.0)
    wait_until(lambda: box.region is not None and abs(box.region.turn_deg - 90) < 1e-6)
    reach = settled(box).figures["b.ply"].points.xyz
    assert np.ptp(reach, axis=0) == pytest.approx((1, 4, 0), abs=0.05)
    handles = box._drawn._handles
    handles.position = np.array([2.0, 1.0, 0.5])
    handles.wxyz = np.array([1.0, 0, 0, 0])
    box._drawn._drag()
    assert box.region is not None
    assert box.region.T_local_box[:3, 3] == pytest.approx((2, 1, 0.5))
    wait_until(lambda: box._turn.value == 0)
    assert box._drawn._frame.position == pytest.approx((2, 1, 0.5))
    handles.position = np.array([1e30, 0, 0])
    box._drawn._drag()
    assert np.abs(box.region.T_local_box[:3, 3]).max() <= FARTHEST_M
    assert settled(box).figures == {}


def test_it_turns_to_the_plane(app: App, box: BoxPanel):
    region = Region.about(np.array([0.0, 0, 0.3]), np.full(3, 3.0))
    T = region.T_local_box
    T[:3, :3] = [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]]
    box.put(region)
    settled(box)
    assert not box._flush.disabled
    box._to_plane()
    assert box.region is not None
    assert np.allclose(np.abs(box.region.T_local_box[:3, :3]), np.eye(3), atol=1e-3)
    assert box.region.T_local_box[2, 3] == pytest.approx(0, abs=1e-3)


def test_it_turns_to_the_plane_that_has_most_points_on_it(app: App, box: BoxPanel):
    """Not to that of the cloud with the most points in the box."""
    box.put(Region.about(np.zeros(3), np.full(3, 2.0)))
    told = settled(box).figures["b.ply"]
    assert told.flatness is not None
    upright = replace(told.flatness, normal=np.array([1.0, 0.05, 0]), share=0.6)
    few = replace(told, points=told.points[: len(told.points) * 7 // 10])
    box.figures = {"cluttered": replace(told, flatness=upright), "flat": few}
    box._to_plane()
    assert box.region is not None
    assert box.region.T_local_box[:3, 2] == pytest.approx((0, 0, 1), abs=1e-3)
    assert box.region.T_local_box[0, 0] == pytest.approx(1)


def test_hidden_clouds_and_boxes_tell_nothing(app: App, box: BoxPanel):
    click(app, 10, 0)
    box._here()
    app.scene._folders["b.ply"].set(visible=False)
    box.put(box.region)
    assert set(settled(box).figures) == {"a.ply"}
    app.scene._folders["b.ply"].set(visible=True)
    set_value(box._shown, False)
    wait_until(lambda: box.region is None)
    wait_until(lambda: box._text.content == "")
    assert not box._drawn._frame.visible
    set_value(box._shown, True)


def test_of_too_many_points_the_coarsest_are_looked_through_and_that_is_told(
    app: App, box: BoxPanel, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(drawn_octrees, "MOST_WITHIN", 150_000)
    box.put(Region.about(np.zeros(3), np.full(3, 50.0)))
    one = settled(box).figures["b.ply"]
    counts = np.cumsum(app.octrees._trees["b.ply"].nodes["count"])  # the coarsest come first
    assert 10_000 < len(one.points) == counts[counts <= 150_000][-1]
    assert one.whole == 400_000
    assert "of some 400,000 near it" in box._text.content


def test_a_box_that_is_gone_before_it_is_told_tells_nothing(
    app: App, box: BoxPanel, monkeypatch: pytest.MonkeyPatch
):
    box.put(None)
    settled(box)
    figures, begun, gone = Gatherer.figures, threading.Event(), threading.Event()

    def late(gatherer: Gatherer, region: Region | None) -> Mapping[str, BoxFigures]:
        begun.set()
        assert gone.wait(60)
        return figures(gatherer, region)

    monkeypatch.setattr(Gatherer, "figures", late)
    box.put(Region.about(np.zeros(3), np.full(3, 2.0)))
    assert begun.wait(60)
    box.put(None)
    gone.set()
    assert settled(box).figures == {}


def test_buttons_pressed_without_points_do_nothing(app: App, box: BoxPanel):
    box._clicked.clear()
    box._here()
    box._between()
    box._to_plane()
    set_value(box._size, (3.0, 3.0, 3.0))
    set_value(box._turn, 12.0)
    assert box.region is None


def test_its_points_are_files_in_tab_export(app: App, box: BoxPanel):
    click(app, 10, 0)
    box._here()
    settled(box)
    assert "box of b.ply" in app.export._links.content
    answer = app.export._cloud({"name": "box of b.ply", "kind": "pcd"})
    cloud = decode_pcd(answer.body)
    told = box.figures["b.ply"].points
    assert np.allclose(cloud.xyz, told.xyz, atol=1e-3)
    assert cloud.intensity is not None
    box.put(None)
    settled(box)
    assert "box of" not in app.export._links.content


def test_frames_tell_anew_and_the_box_stays_in_the_map():
    with App.made(Address(port=0), Opened((Frames(),))) as app:
        app.view.start()
        wait_until(lambda: app.view.moment is not None)
        local = np.array([10.0, 0, 0])
        app.box.put(Region.about(local, np.full(3, 2.0)))
        wait_until(lambda: bool(app.box.figures))
        before = next(iter(app.box.figures.values())).middle_m
        app.view.step(1)  # the rig drives 1 m
        wait_until(lambda: next(iter(app.box.figures.values())).middle_m[0] < before[0] - 0.8)


CAMERA = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), 100, 80)


def seen(index: int) -> Moment:
    """Ground with sigma below a camera that stands at (0, 0, 2) of the rig, which drives 1 m."""
    xyz = np.random.default_rng(0).uniform((2, -5, 0), (22, 5, 0), (4000, 3))
    T_forward_camera, T_map_forward = np.eye(4), np.eye(4)
    T_forward_camera[:3, 3] = (0, 0, 2)
    T_map_forward[:3, 3] = np.add(UTM, (index, 0, 0))
    stereo = PointCloud(xyz, "rig", sigma_m=np.full(4000, 0.1, np.float32))
    return Moment(
        str(index), index, clouds={"stereo": stereo}, sight=Sight(CAMERA, T_forward_camera),
        T_map_forward=T_map_forward,
    )  # fmt: skip


@pytest.fixture(scope="module")
def driven() -> Iterator[App]:
    with App.made(Address(port=0), Opened((Frames(),), (StillCloud("a.ply", ground()),))) as made:
        yield made


def test_figures_of_a_frame_are_of_all_its_points_and_of_its_camera(driven: App):
    driven.view.stage.looks["stereo"] = Look(most_points=10)
    driven.view.show(seen(0))
    assert len(driven.view.stage.shown["stereo"]) <= 10
    place = driven.view.stage.placement.local(seen(0).T_map_forward)[:3, 3]
    told = driven.box._gatherer.figures(Region.about(np.add(place, (10, 0, 0)), np.full(3, 2.0)))
    flat = told["stereo"].flatness
    assert len(told["stereo"].points) > 50
    assert flat is not None
    assert flat.seen
    # The camera looks at it from 2 m above and 10 m away.
    assert flat.expected_m == pytest.approx(0.1 * 2 / np.hypot(10, 2), rel=0.05)


def test_what_lies_still_is_told_once_and_frames_each_time(driven: App):
    gatherer = driven.box._gatherer
    driven.view.show(seen(0))
    region = Region.about(np.array([0.0, 0, 0]), np.full(3, 6.0))
    one = gatherer.figures(region)
    driven.view.show(seen(1))
    other = gatherer.figures(region)
    assert other["a.ply"] is one["a.ply"]
    assert other["stereo"] is not one["stereo"]
    assert gatherer.figures(replace(region))["a.ply"] is not one["a.ply"]
    driven.view.stage.arrange(frozenset(), {"a.ply": (3.0, 0.0, 0.0)})
    aside = gatherer.figures(region)["a.ply"]
    driven.view.stage.arrange(frozenset({"a.ply"}), {})
    assert set(gatherer.figures(region)) == {"stereo"}
    driven.view.stage.arrange(frozenset(), {})
    assert aside.middle_m[0] == pytest.approx(one["a.ply"].middle_m[0] - 3, abs=0.3)


def test_clouds_and_their_place_are_of_one_frame(driven: App):
    """While a frame is on its way the stage stands where the one before was."""
    driven.view.show(seen(2))
    region = Region.about(driven.view.stage.placement.T_local_rig[:3, 3], np.ones(3) * 9)
    there = driven.box._gatherer.figures(region)["stereo"].middle_m
    driven.view.show(seen(0))
    driven.view.moment = seen(2)
    assert driven.box._gatherer.figures(region)["stereo"].middle_m == pytest.approx(there)


def test_a_click_is_where_it_was_when_it_was_made(driven: App, monkeypatch: pytest.MonkeyPatch):
    """A frame that is drawn while the point is searched for moves the map under the scene."""
    search = points.picked

    def slow(*asked: Any) -> Any:
        found = search(*asked)
        driven.view.show(seen(2))
        return found

    driven.view.stage.looks["stereo"] = Look()
    for picked in (search, slow):
        driven.view.show(seen(0))
        monkeypatch.setattr(points, "picked", picked)
        at = driven.view.stage.shown["stereo"].xyz[7]
        driven.points.click(np.add(at, (0, 0, 8)), np.array([0, 0, -1.0]))
    first, second = driven.box._clicked
    assert first == pytest.approx(second)


def test_marks_are_of_the_frame_in_which_they_were_set(driven: App):
    driven.view.show(seen(0))
    marks = driven.view.marks
    marks.show_place(np.array([1.0, 2, 3]))
    pose = Pose.from_rotation("left", "box", np.eye(3), np.array([0.0, 0, 5]))
    marks.show_box(Box3D(pose, 4.0, 2.0, 1.0))
    assert marks._place.visible
    assert marks._place.position == pytest.approx((1, 2, 3))
    assert marks._box.visible
    assert marks._box.points.reshape(-1, 3).mean(axis=0) == pytest.approx((0, 0, 7))
    driven.view.show(seen(1))
    assert not marks._place.visible
    assert not marks._box.visible
