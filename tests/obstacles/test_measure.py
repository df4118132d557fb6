"""Detections to obstacles: what is its own is measured, nothing is without a distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.obstacles.measure import measured
from pseudolidar.structures.box import Detection
from pseudolidar.structures.disparity import DepthMap
from tests.obstacles.scene import (
    EYE_HEIGHT_M,
    HEIGHT,
    WALL_M,
    WIDTH,
    Thing,
    box_px,
    detection,
    sight,
)

# Seen from behind: as wide and high as cars and people are.
CAR: Thing = ("Car", -1.0, 12.0, 1.65, 1.53)
FAR_CAR: Thing = ("Car", 1.5, 22.0, 1.65, 1.53)
PERSON: Thing = ("Pedestrian", 4.0, 15.0, 0.65, 1.74)


def measure(things, seen=None, **how):
    return measured(sight(things, **how), [detection(one) for one in seen or things])


@pytest.mark.parametrize("ground", [True, False])
def test_things_are_as_far_as_they_are(ground: bool) -> None:
    things = (CAR, FAR_CAR, PERSON)
    found = measure(things, ground=ground)
    for thing, obstacle in zip(things, found, strict=True):
        assert obstacle.detection.name == thing[0]
        assert abs(obstacle.distance_m - thing[2]) < 2 * obstacle.sigma_distance_m
        assert obstacle.sigma_distance_m < 0.8
        assert obstacle.box.width_m == pytest.approx(thing[3], abs=0.2)
        assert obstacle.box.height_m == pytest.approx(thing[4], abs=0.1)
        assert obstacle.box.pose.translation_m[0] == pytest.approx(thing[1], abs=0.15)
        assert not obstacle.truncated
        assert obstacle.measured_by == "points"
        assert obstacle.confidence > 0.6


def test_what_hides_a_thing_is_not_taken_for_it() -> None:
    hider: Thing = ("Car", 0.4, 9.0, 1.65, 1.53)
    hidden: Thing = ("Car", 1.5, 20.0, 1.65, 1.53)
    found = measure((hider, hidden))
    assert [round(one.distance_m) for one in found] == [9, 20]
    assert [one.occluded for one in found] == [False, True]
    # nor where nobody detected what hides it, as long as some of the thing is seen
    (alone,) = measure((hider, hidden), (hidden,))
    assert round(alone.distance_m) == 20
    assert not set(found[0].pixels) & set(found[1].pixels)


def test_a_box_drawn_wide_does_not_take_the_wall_behind() -> None:
    left, top, right, bottom = detection(PERSON).box_px
    wide = Detection("Pedestrian", (left - 12, top - 4, right + 12, bottom + 4))
    (found,) = measured(sight((PERSON,)), [wide])
    assert found.distance_m == pytest.approx(15.0, abs=0.4)
    assert WALL_M > 50


def test_a_thing_without_a_class_is_measured_too() -> None:
    post: Thing = ("region", 2.0, 10.0, 0.3, 1.2)
    (found,) = measure((post,))
    assert found.distance_m == pytest.approx(10.0, abs=0.3)
    assert found.box.width_m == pytest.approx(0.3, abs=0.15)
    assert found.box.height_m == pytest.approx(1.2, abs=0.2)


def test_without_points_size_and_footing_say_how_far_and_how_badly() -> None:
    seen = sight((CAR,))
    seen.depth.values[:] = np.nan
    (found,) = measured(seen, [detection(CAR)])
    assert found.measured_by == "size"
    assert abs(found.distance_m - 12.0) < 2 * found.sigma_distance_m
    assert found.sigma_distance_m > 0.5
    assert found.confidence <= 0.1
    assert found.points == 0


def test_what_the_border_cuts_is_told() -> None:
    (found,) = measure((("Car", -9.6, 12.0, 1.65, 1.53),))
    assert found.truncated
    assert found.distance_m == pytest.approx(12.0, abs=0.5)


def test_nothing_found_is_a_valid_result() -> None:
    assert measured(sight((CAR,)), []) == ()


def test_a_worse_rig_says_so() -> None:
    seen = sight((FAR_CAR,))
    stock = replace(seen, shared_px=0.5)
    (good,), (bad,) = (measured(one, [detection(FAR_CAR)]) for one in (seen, stock))
    assert bad.sigma_distance_m > good.sigma_distance_m + 0.3


def test_a_thing_hidden_to_its_shoulders_stands_on_the_ground() -> None:
    """Its box shows what is seen of it; the height is from the ground to the top of that."""
    person, car = ("Pedestrian", 0.0, 12.0, 0.6, 1.75), ("Car", 0.0, 10.0, 3.9, 1.2)
    left, top, right, _ = box_px(person)
    behind = Detection("Pedestrian", (left, top, right, box_px(car)[1] - 1))
    found = measured(sight([person, car]), [behind, detection(car)])[0]
    assert found.distance_m == pytest.approx(12.0, abs=0.6)
    assert found.box.height_m == pytest.approx(1.75, abs=0.2)
    under = found.box.pose.matrix[1, 3] + found.box.height_m / 2
    assert under == pytest.approx(EYE_HEIGHT_M, abs=0.1)


def test_what_hangs_is_as_high_as_itself() -> None:
    """A traffic light that the upper border cuts, 4 m above the ground."""
    light = Detection("traffic light", (310.0, 0.0, 330.0, 40.0))
    seen = sight([])
    depth = seen.depth.values.copy()
    depth[0:41, 310:331] = 15.0
    found = measured(replace(seen, depth=replace(seen.depth, values=depth)), [light])[0]
    assert abs(found.distance_m - 15.0) < 2 * found.sigma_distance_m
    assert found.box.height_m < 2.5  # 40 px are 1.5 m; its top is 5.3 m above the ground


def test_of_a_cut_box_without_points_its_size_is_a_bound_alone() -> None:
    """A corner of something at the border may be small because it is cut."""
    seen = sight([])
    nothing = replace(seen, depth=DepthMap(np.full((HEIGHT, WIDTH), np.nan, np.float32)))
    corner = Detection("Car", (630.0, 232.0, 639.0, 239.0))
    (found,) = measured(nothing, [corner])
    assert found.measured_by == "size"
    assert found.distance_m - 2 * found.sigma_distance_m < 5.0
