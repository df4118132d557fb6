"""Riders and what they ride: two in the picture, one place in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.obstacles.measure import measured
from pseudolidar.obstacles.riding import ride
from pseudolidar.structures.box import Detection
from tests.obstacles.scene import sight

# A bike 8 m away, 1.1 m high, and its rider above it, both as one surface; a wall behind.
PLACE_M = 8.0
BIKE = Detection("bicycle", (280.0, 124.0, 360.0, 179.0), 0.9)
RIDER = Detection("person", (295.0, 92.0, 340.0, 165.0), 0.8)


def ridden():
    return sight((("bike", 0.0, PLACE_M, 1.7, 1.1), ("rider", 0.0, PLACE_M, 0.6, 1.75)))


def test_who_rides_what() -> None:
    assert ride(RIDER, BIKE)
    assert ride(BIKE, RIDER)
    beside = Detection("person", (365.0, 92.0, 400.0, 165.0))
    before = Detection("person", (295.0, 92.0, 340.0, 230.0))  # stands before it
    for other in (beside, before, Detection("car", RIDER.box_px), BIKE):
        assert not ride(other, BIKE)


@pytest.mark.parametrize("order", [(BIKE, RIDER), (RIDER, BIKE)])
def test_a_rider_is_where_his_bike_is(order) -> None:
    found = {one.detection.name: one for one in measured(ridden(), order)}
    for one in found.values():
        assert one.distance_m == pytest.approx(PLACE_M, abs=2 * one.sigma_distance_m)
        assert one.sigma_distance_m < 0.5
    shared = np.intersect1d(found["bicycle"].pixels, found["person"].pixels)
    assert len(shared) > 100


def test_what_is_left_of_a_hidden_thing_is_unsure() -> None:
    """A person of whom a car leaves a strip: it may be the fence behind."""
    scene = sight((("Car", 0.0, 8.0, 1.7, 1.5), ("fence", 0.0, 10.5, 8.0, 2.2)))
    car = Detection("Car", (277.0, 104.0, 362.0, 179.0), 0.9)
    alone = Detection("person", (400.0, 94.0, 425.0, 163.0), 0.5)
    half = Detection("person", (350.0, 94.0, 375.0, 163.0), 0.5)
    _, free, hidden = measured(scene, (car, alone, half))
    assert hidden.occluded
    assert not free.occluded
    assert hidden.distance_m == pytest.approx(free.distance_m, abs=0.5)
    assert hidden.sigma_distance_m > 2 * free.sigma_distance_m


def test_what_stands_where_the_search_ends_is_told_as_a_bound() -> None:
    scene = replace(ridden(), searched_px=25)  # 8 m are 25 px
    assert all(one.bound for one in measured(scene, (BIKE, RIDER)))
    assert not any(one.bound for one in measured(ridden(), (BIKE, RIDER)))
