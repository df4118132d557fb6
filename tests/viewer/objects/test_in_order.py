"""Who is who while frames are shown in their order, and after jumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.viewer.objects.in_order import LONGEST_STEP_S, InOrder, Told
from pseudolidar.viewer.objects.objects import Objects
from pseudolidar.viewer.objects.scene import shown_objects
from pseudolidar.viewer.objects.shown import Band
from tests.formats.made_obstacles import car, upright
from tests.obstacles.scene import CAMERA

STEP_NS = 100_000_000


def at(z_m: float) -> Obstacle:
    one = car(track=False)
    return replace(one, distance_m=z_m - 2, box=replace(one.box, pose=upright(-2.5, 0.9, z_m, 0.3)))


def keys(told: Told) -> list[str]:
    return [one.key for one in shown_objects(told, Band(), np.eye(4))]


def told(order: InOrder, index: int, *things: Obstacle, time_ns: int | None = None) -> Told:
    time_ns = 1_000_000_000 + index * STEP_NS if time_ns is None else time_ns
    return order(index, time_ns, Objects(things), CAMERA)


def test_what_is_followed_has_one_key_that_nothing_else_gets():
    order = InOrder(Tracker())
    (first,) = keys(told(order, 0, at(22)))
    assert keys(told(order, 1, at(22))) == [first]
    (back,) = keys(told(order, 0, at(40)))
    assert back != first
    (far,) = keys(told(order, 1, at(22), time_ns=10**12))
    assert far not in (first, back)


@pytest.mark.parametrize(
    ("step_s", "follows"), [(0.0, False), (LONGEST_STEP_S, True), (LONGEST_STEP_S + 0.01, False)]
)
def test_frames_follow_one_another_up_to_a_step(step_s: float, follows: bool):
    order = InOrder(Tracker())
    before = keys(told(order, 0, at(22), time_ns=10**9))
    after = keys(told(order, 1, at(22), time_ns=10**9 + round(step_s * 10**9)))
    assert (after == before) is follows
    assert after[0].startswith("track ")


def test_what_is_not_followed_has_its_place_in_the_frame():
    order = InOrder(None)
    assert keys(told(order, 0, at(40), at(22))) == ["object 2", "object 1"]


def test_what_is_hidden_for_a_while_is_told_where_it_should_be():
    order = InOrder(Tracker())
    for index in range(4):
        (key,) = keys(told(order, index, at(22)))
    hidden = told(order, 4)
    assert keys(hidden) == [key]
    (one,) = hidden.obstacles
    assert one.coasts
    assert one.distance_m == pytest.approx(20, abs=1.5)
