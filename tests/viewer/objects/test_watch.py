"""Objects that the viewer shows against those that `pseudolidar obstacles` finds."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.obstacles import Obstacles, finder
from pseudolidar.pipelines.obstacles import opened as obstacles_opened
from pseudolidar.pipelines.view import View, reel_by

from pseudolidar.errors import StereoConfig
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.running.finding import figures
from pseudolidar.running.products.corridor_table import watched
from pseudolidar.running.products.found import Found
from pseudolidar.running.sighting import Seen
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.objects import Find
from pseudolidar.viewer.objects.scene import ObjectScene
from pseudolidar.viewer.objects.shown import SURE, Band
from pseudolidar.viewer.objects.teller import Wish
from pseudolidar.viewer.objects.watch import ObjectWatch
from pseudolidar.viewer.remembered import RememberedSights

CORRIDOR = Corridor(2.0, 2.0, 30.0)
KITTI_OBJECT = Path("/work/shared/data/kitti_object/training")


@dataclass
class Looked:
    """A source in the viewer and for `obstacles`."""

    watch: ObjectWatch
    moments: list[Moment]
    found: list[Found]
    came: threading.Semaphore

    def scene(self, index: int) -> ObjectScene:
        moment = self.moments[index]
        while not self.watch.ready(moment):
            assert self.came.acquire(timeout=60)
        return self.watch.scene(moment)


def looked(source: Source, indices: range) -> Looked:
    job = Obstacles(source, detector=Labels(), corridor=CORRIDOR)
    find = finder(job, obstacles_opened(job))
    reel = reel_by(View().conversion(source))
    came = threading.Semaphore(0)
    watch = ObjectWatch(reel.sighted, {}, lambda _: came.release())
    moments = [reel.load(index) for index in indices]
    frames = [moment.converted.frame for moment in moments if moment.converted]
    return Looked(watch, moments, [find.found(frame) for frame in frames], came)


@pytest.fixture(scope="module")
def street() -> Iterator[Looked]:
    made = looked(Synthetic("street", frames=3, width_px=512), range(3))
    yield made
    made.watch.close()


LABELS = Wish(detect=Labels().load(), corridor=CORRIDOR, tracker=Tracker())


def check_same(shown: ObjectScene, found: Found, moment: Moment) -> None:
    assert moment.sight is not None
    T = moment.sight.T_forward_camera
    assert len(shown.objects) == len(found.obstacles) > 0
    for one, obstacle in zip(shown.objects, found.obstacles, strict=True):
        assert one.obstacle.distance_m == obstacle.distance_m
        assert one.obstacle.sigma_distance_m == obstacle.sigma_distance_m
        assert one.distance.startswith(f"{obstacle.distance_m:.1f}"[:3])
        there = obstacle.box.corners_m() @ T[:3, :3].T + T[:3, 3]
        assert np.allclose(one.corners_m, there)
    points = sum(obstacle.points for obstacle in found.obstacles)
    assert len(shown.xyz) == len(shown.colours) == points


def test_objects_are_where_the_library_says(street: Looked):
    street.watch.ask(replace(LABELS, tracker=None))
    for index in (0, 2):
        check_same(street.scene(index), street.found[index], street.moments[index])


@pytest.mark.real
def test_objects_of_kitti_are_where_the_library_says():
    if not KITTI_OBJECT.is_dir():
        pytest.skip("no KITTI object data")
    made = looked(recognise(str(KITTI_OBJECT)), range(1))
    made.watch.ask(replace(LABELS, tracker=None))
    shown = made.scene(0)
    check_same(shown, made.found[0], made.moments[0])
    # A label's box lies where its object was measured; far away the stock rig is metres off.
    near = [one for one in shown.objects if one.obstacle.distance_m < 20]
    assert near
    for one in near:
        away = min(np.linalg.norm(one.middle_m - t.corners_m.mean(axis=0)) for t in shown.truths)
        assert away < 1.5
    made.watch.close()


def test_points_of_objects_lie_in_their_boxes(street: Looked):
    street.watch.ask(replace(LABELS, tracker=None))
    shown = street.scene(0)
    nearest = shown.objects[0]
    own = shown.xyz[: nearest.obstacle.points]
    low, high = nearest.corners_m.min(axis=0) - 0.7, nearest.corners_m.max(axis=0) + 0.7
    assert np.mean(((own > low) & (own < high)).all(axis=1)) > 0.9


def test_identities_stay_while_frames_come_in_order(street: Looked):
    street.watch.ask(LABELS)
    keys = [[one.key for one in street.scene(index).objects] for index in range(3)]
    assert keys[0][:3] == keys[1][:3] == keys[2][:3]
    assert keys[0][0].startswith("track ")
    again = street.scene(2)
    assert [one.key for one in again.objects] == keys[2]
    believed = {one.obstacle.track.state for one in again.objects if one.obstacle.track}
    assert "confirmed" in believed
    # Going back, nobody knows who they were: it begins anew.
    back = street.scene(0)
    assert not {one.key for one in back.objects} & {*keys[0], *keys[1], *keys[2]}
    assert {one.obstacle.track.state for one in back.objects if one.obstacle.track} == {"tentative"}


def test_the_corridor_is_told_as_in_its_table(street: Looked):
    street.watch.ask(LABELS)
    rows = watched([(f.frame.id, f.frame.timestamp_ns / 1e9, figures(f)) for f in street.found])
    for index, row in enumerate(rows):
        shown = street.scene(index)
        assert shown.corridor is not None
        assert row.ahead is not None
        assert f"{row.ahead.distance_m:.2f} ± {row.ahead.sigma_m:.2f} m" in shown.corridor.text
        assert shown.corridor.nearest_m is not None
        reached = row.approach is not None and row.approach.contact_s is not None
        assert ("reached in" in shown.corridor.text) == reached
        # The thing lies in the box that is drawn.
        low, high = (getattr(shown.corridor.corners_m, end)(axis=0) - 0.6 for end in ("min", "max"))
        assert (low < shown.corridor.nearest_m).all()
        assert (shown.corridor.nearest_m < high + 1.2).all()


def test_a_corridor_needs_no_detector(street: Looked):
    street.watch.ask(Wish(corridor=CORRIDOR))
    shown = street.scene(1)
    assert shown.corridor is not None
    assert not shown.objects
    assert len(shown.truths) > 5  # labels of the data cost nothing


def test_limits_hide_what_is_beyond(street: Looked):
    street.watch.ask(replace(LABELS, tracker=None))
    street.watch.band = Band(0, 15, 0)
    shown = street.scene(0)
    street.watch.band = Band()
    every = street.found[0].obstacles
    near = [one for one in every if one.distance_m <= 15]
    assert 0 < len(near) < len(every)
    assert [one.obstacle.distance_m for one in shown.objects] == [one.distance_m for one in near]
    assert len(shown.xyz) == sum(one.points for one in near)
    assert f"{len(every) - len(near)} more" in shown.text
    assert not Band(least_m=9.0).holds(every[0])


def test_elsewhere_the_same_is_drawn_from_the_first_frame_on(street: Looked):
    watch = street.watch
    watch.ask(LABELS)
    watch.band = Band(0, 15, 0)
    page = [street.scene(index) for index in range(2)]
    scenes = watch.at_once()
    film = [scenes(moment) for moment in street.moments[:2]]
    again = street.scene(1)
    watch.band = Band()
    for shown, drawn, found in zip(page, film, street.found, strict=False):
        told, same = (
            [(one.name, one.obstacle.distance_m) for one in scene.objects]
            for scene in (shown, drawn)
        )
        assert told == same
        assert 0 < len(told) < len(found.obstacles)
        assert drawn.corridor is not None
    assert film[0].objects[0].key == film[1].objects[0].key  # it follows them by itself
    assert [one.key for one in again.objects] == [one.key for one in page[1].objects]


def test_what_a_run_found_is_shown_by_frame(street: Looked):
    run: dict[str, tuple[Obstacle, ...]] = {
        street.moments[1].id: street.found[1].obstacles[:2],
    }
    watch = ObjectWatch(None, run, lambda _: None)
    watch.ask(Wish(of_run=True))
    assert watch.ready(street.moments[0])
    assert watch.scene(street.moments[0]).text == "0 objects"
    shown = watch.scene(street.moments[1])
    assert [one.obstacle for one in shown.objects] == list(run[street.moments[1].id])
    watch.close()


def test_unsure_ones_are_known(street: Looked):
    street.watch.ask(replace(LABELS, tracker=None))
    for one in street.scene(0).objects:
        seen = one.obstacle
        assert one.sure == (seen.measured_by != "size" and seen.confidence >= SURE)
        assert one.row["sure"] == one.sure


def test_other_ways_to_find_choose_nothing(street: Looked):
    watch = ObjectWatch(None, {}, lambda _: None)
    watch.ask(LABELS)
    watch.chosen = "track 1.1"
    watch.ask(replace(LABELS, corridor=None))
    assert watch.chosen == "track 1.1"
    for wish in (replace(LABELS, tracker=None), replace(LABELS, detect=None), Wish(of_run=True)):
        watch.chosen = "track 1.1"
        watch.ask(wish)
        assert watch.chosen == ""
    watch.close()


def test_the_last_wish_is_the_one_that_is_looked_for(monkeypatch: pytest.MonkeyPatch):
    watch = ObjectWatch(lambda _: None, {}, lambda _: None)  # type: ignore[arg-type, return-value]
    begun, asked = threading.Event(), threading.Event()
    found: list[Find] = []

    def change(find: Find) -> None:
        if find.corridor is CORRIDOR:
            begun.set()
            asked.wait(0.2)
        found.append(find)

    monkeypatch.setattr(watch._finder, "change", change)
    first = threading.Thread(target=watch.ask, args=[LABELS])
    first.start()
    assert begun.wait(60)
    watch.ask(replace(LABELS, corridor=None))
    asked.set()
    first.join()
    assert found[-1].corridor is None
    watch.close()


def test_objects_are_found_anew_where_frames_are_seen_otherwise(street: Looked):
    came = threading.Semaphore(0)
    sights = RememberedSights(refusing("first"))
    watch = ObjectWatch(sights, {}, lambda _: came.release())
    sights.on_change(watch.again)
    watch.ask(LABELS)
    again = Looked(watch, street.moments, [], came)
    assert "first" in again.scene(0).text
    sights.change(refusing("second"))
    assert "second" in again.scene(0).text
    watch.close()


def refusing(why: str) -> Callable[[Frame], Seen]:
    def sighted(_frame: Frame) -> Seen:
        raise StereoConfig(why, want="something else")

    return sighted


def test_what_hinders_is_told(street: Looked):
    watch = ObjectWatch(None, {}, lambda _: None)
    watch.ask(LABELS)
    assert watch.ready(street.moments[0])  # nobody waits for what will not come
    assert "Nothing can be measured" in watch.scene(street.moments[0]).text
    assert watch.scene(Moment("x", 0, fault="gone")).text == ""
    watch.close()
