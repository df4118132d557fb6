"""Bands of errors with known answers; labels find their obstacles."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.obstacles import (
    JudgedObject,
    by_band,
    is_judged,
    judged_objects,
    size_errors,
    usual_by_band,
)
from pseudolidar.evaluation.obstacles_report import ObstaclesReport
from pseudolidar.geometry.box_in_view import nearest_depth_m, outline_px
from pseudolidar.obstacles.measure import measured
from pseudolidar.structures.box import Box3D, Detection, Label
from pseudolidar.structures.pose import Pose
from tests.obstacles.scene import CAMERA, detection, sight

AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # a box that looks ahead


def box(x: float, z: float, size=(4.0, 1.6, 1.5)) -> Box3D:
    place = np.array([x, 1.6 - size[2] / 2, z])
    return Box3D(Pose.from_rotation("camera_left", "box", AXES, place), *size)


def judged(true_m: float, measured_m: float | None, sigma_m: float | None = 0.5) -> JudgedObject:
    off = None if measured_m is None else (0.1, -0.2, 0.3)
    return JudgedObject("f", "Car", true_m, true_m + 2, measured_m, sigma_m, true_m + 3, off)


def test_bands_are_of_the_true_distance_and_count_what_is_missed() -> None:
    objects = [judged(10, 10.2), judged(14.9, 14.2), judged(15, 15.1), judged(20, None, None)]
    near, middle, far, farthest = by_band(objects)
    assert (near.from_m, near.to_m, near.n, near.missed) == (0, 15, 2, 0)
    assert near.median_abs_m == pytest.approx(0.45)
    assert near.p90_abs_m == pytest.approx(0.65)
    assert near.bias_m == pytest.approx(-0.25)
    assert near.within_1_sigma == 0.5
    assert (middle.n, middle.missed, middle.within_1_sigma) == (2, 1, 1.0)
    assert far.as_dict() | farthest.as_dict() == {
        **{"from_m": 50, "to_m": 90, "n": 0, "median_abs_m": None, "p90_abs_m": None},
        **{"bias_m": None, "missed": 0, "within_1_sigma": None},
    }
    assert usual_by_band(objects)[0].bias_m == pytest.approx(1.0)
    report = ObstaclesReport("ours", objects, 1, found_by_labels=False)
    assert report.recall == 0.75
    assert report.within_1_sigma == pytest.approx(2 / 3)
    assert "few: not judged" in report.text()
    count, off = size_errors(objects, names=("Car",), nearer_than_m=15.0)
    assert count == 2
    np.testing.assert_allclose(off, (0.1, 0.2, 0.3))


def test_the_nearest_face_is_that_of_the_part_in_view() -> None:
    assert nearest_depth_m(box(0.0, 20.0), CAMERA) == pytest.approx(18.0)
    # the near end of a long thing beside the camera is out of view
    assert nearest_depth_m(box(6.0, 8.0, (14.0, 2.0, 2.0)), CAMERA) == pytest.approx(
        5.0 * 400 / 319.5, rel=0.05
    )
    assert nearest_depth_m(box(50.0, 5.0), CAMERA) is None
    left, top, right, bottom = outline_px(box(0.0, 20.0), CAMERA)
    assert right - left == pytest.approx(1.6 * 400 / 18)
    assert bottom == pytest.approx(1.6 * 400 / 18 + 99.5)
    assert top == pytest.approx(0.1 * 400 / 22 + 99.5)
    assert outline_px(box(0.0, 1.0), CAMERA) is None


def test_labels_that_are_cut_or_hidden_do_not_count() -> None:
    label = Label(Detection("Car", (0.0, 0, 9, 9)), box(0, 10), truncation=0.1, occlusion=1)
    from dataclasses import replace

    assert is_judged(label)
    changes = ({"truncation": 0.2}, {"occlusion": 2}, {"ignore": True}, {"box": None})
    assert not any(is_judged(replace(label, **change)) for change in changes)


def test_a_label_gets_the_obstacle_that_overlaps_it_best() -> None:
    thing = ("Car", 0.0, 18.0, 1.6, 1.5)
    seen = sight((thing,))
    found = measured(seen, [detection(thing)])
    label = Label(found[0].detection, box(0.0, 20.0))
    (one,) = judged_objects("f", [label], found, CAMERA, seen.depth)
    assert one.true_m == pytest.approx(18.0)
    assert one.measured_m == found[0].distance_m
    assert one.usual_m == pytest.approx(18.0, abs=0.3)
    left, top, right, bottom = label.detection.box_px
    beside = Label(Detection("Car", (left + 60, top, right + 60, bottom)), box(0.0, 20.0))
    (other,) = judged_objects("f", [beside], found, CAMERA, seen.depth)
    assert other.measured_m is None
