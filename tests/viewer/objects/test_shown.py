"""Objects as they are drawn: arrows and words."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.viewer.objects.drawn import DrawnObjects
from pseudolidar.viewer.objects.scene import ObjectScene, Parts
from pseudolidar.viewer.objects.shown import ShownObject
from pseudolidar.viewer.server import GuardedServer
from tests.formats.made_obstacles import car, light


def T_forward_camera() -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R_BODY_OPTICAL, (0.3, 0.0, 1.6)
    return T


def test_an_arrow_leads_to_where_a_thing_is_a_second_later():
    one = ShownObject.of(1, car(), T_forward_camera())
    assert one.arrow_m is not None
    begin, end = one.arrow_m
    assert begin == pytest.approx(one.middle_m)
    assert end - begin == pytest.approx([-8.25, -0.5, 0.0])  # comes nearer, and to the right
    assert ShownObject.of(1, light(), T_forward_camera()).arrow_m is None


def test_words_that_would_cover_others_are_not_drawn(server: GuardedServer):
    drawn = DrawnObjects(server.viser)
    behind = [ShownObject.of(number, car(), T_forward_camera()) for number in (1, 2)]
    aside = ShownObject.of(3, light(), T_forward_camera())
    drawn.show(ObjectScene(objects=(*behind, aside)), Parts())
    shown = [label.text for label in drawn._labels if label.visible]
    assert shown == [behind[0].label, aside.label]
    drawn.show(ObjectScene(objects=(aside,)), Parts(labels=0))
    assert not any(label.visible for label in drawn._labels)


def test_what_there_is_no_more_is_not_drawn(server: GuardedServer):
    drawn = DrawnObjects(server.viser)
    one = ShownObject.of(1, car(), T_forward_camera())
    points, colours = np.ones((2, 3), np.float32), np.full((2, 3), 9, np.uint8)
    scene = ObjectScene(objects=(one,), xyz=points, colours=colours, chosen=one.key)
    drawn.show(scene, Parts(points=True))
    there = {"sure", "chosen", "arrows", "points"}
    assert {name for name, node in drawn._nodes.items() if node.visible} == there
    drawn.show(ObjectScene(), Parts(points=True))
    assert not any(node.visible for node in drawn._nodes.values())
    drawn.show(ObjectScene(objects=(one,), xyz=2 * points, colours=colours), Parts(points=True))
    assert {name for name, node in drawn._nodes.items() if node.visible} == there - {"chosen"}
    assert np.array_equal(drawn._nodes["points"].points, 2 * points)
