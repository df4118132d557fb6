"""Several detectors as one."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.obstacles.cloud import Cloud
from pseudolidar.obstacles.combined import Combined, merged
from pseudolidar.obstacles.detectors import asked
from pseudolidar.obstacles.regions import Boxes, Regions
from pseudolidar.structures.box import Detection
from tests.obstacles.scene import Thing, box_px, sight

CAR: Thing = ("Car", -1.5, 12.0, 1.65, 1.53)
PERSON: Thing = ("Pedestrian", 3.0, 15.0, 0.65, 1.74)


def test_what_two_detectors_see_is_one_thing_with_the_name_and_the_mask() -> None:
    drawn = Regions(Boxes(box_px=box_px(CAR)), name="Car")
    one = sight((CAR, PERSON))
    for order in ((drawn, Cloud(farthest=50)), (Cloud(farthest=50), drawn)):
        found = Combined(order).load()(one)
        assert sorted(detection.name for detection in found) == ["Car", "thing"]
        car = next(detection for detection in found if detection.name == "Car")
        assert car.box_px == box_px(CAR)
        assert np.median(one.depth.values[car.mask]) == pytest.approx(12, abs=0.5)
        assert car.score == 1.0


def test_each_thing_is_in_one_pair_at_most() -> None:
    a = [Detection("a", (0, 0, 9, 9), 0.5)]
    b = [Detection("b", (0, 0, 9, 8), 0.9), Detection("c", (0, 0, 9, 9), 0.4)]
    found = merged(a, b, 0.5)
    assert [one.name for one in found] == ["a", "b"]  # `c` agrees best with `a`
    assert [one.score for one in found] == [0.5, 0.9]


def test_neighbours_of_one_detector_stay_apart() -> None:
    pair = [Detection("a", (0, 0, 9, 9)), Detection("a", (0, 0, 9, 8))]
    assert len(merged(pair, (), 0.5)) == 2
    assert len(merged((), pair, 0.5)) == 2


def test_masks_may_agree_where_boxes_do_not() -> None:
    mask = np.zeros((40, 40), np.bool_)
    mask[:10, :10] = True
    a = Detection("thing", (0, 0, 9, 9), 0.6, mask)
    b = Detection("Car", (0, 0, 29, 9), 0.7, mask)
    assert [one.name for one in merged([a], [b], 0.5)] == ["Car"]


def test_one_of_two_may_be_left_out() -> None:
    cloud, drawn = Cloud(), Regions(Boxes(box_px=box_px(CAR)))
    assert asked(None, None) is None
    assert asked(cloud, None) is asked(None, cloud) is cloud
    assert asked(drawn, cloud) == Combined((drawn, cloud))


def test_bad_settings_are_named() -> None:
    with pytest.raises(UsageError):
        Combined((Cloud(),), agree=0)
