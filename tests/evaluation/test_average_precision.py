"""KITTI's average precision on cases with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.average_precision import BoxedFrame, average_precisions
from pseudolidar.geometry.box_overlap import overlaps
from pseudolidar.structures.box import Box3D, Detection, Label
from pseudolidar.structures.pose import Pose

TALL = (0.0, 0.0, 60.0, 50.0)  # a box that counts at every difficulty


def box(x=0.0, z=10.0, yaw=0.0, size=(4.0, 2.0, 1.5), y=0.0) -> Box3D:
    c, s = np.cos(yaw), np.sin(yaw)
    axes = np.array([[s, -c, 0.0], [0.0, 0.0, -1.0], [c, s, 0.0]])
    return Box3D(Pose.from_rotation("camera_left", "box", axes, np.array([x, y, z])), *size)


def test_boxes_share_what_they_share() -> None:
    assert overlaps(box(), box()) == pytest.approx((1.0, 1.0), abs=1e-5)
    # half of the length apart: a third
    assert overlaps(box(), box(z=12.0)) == pytest.approx((1 / 3, 1 / 3), abs=1e-5)
    # a square turned by 45 degrees: an octagon
    square = (2.0, 2.0, 2.0)
    eight = 2 * (np.sqrt(2) - 1)
    turned = overlaps(box(size=square), box(size=square, yaw=np.pi / 4))
    assert turned == pytest.approx((eight / (2 - eight),) * 2, abs=1e-5)
    # half as high: the same from above, a third in space
    assert overlaps(box(), box(y=0.75)) == pytest.approx((1.0, 1 / 3), abs=1e-5)
    assert overlaps(box(), box(x=9.0)) == (0.0, 0.0)
    assert overlaps(box(), box(yaw=np.pi))[0] == pytest.approx(1.0, abs=1e-5)


def label(name="Car", box_px=TALL, truncation=0.0, occlusion=0, ignore=False) -> Label:
    return Label(Detection(name, box_px), box(), truncation, occlusion, ignore)


def frame(labels, found, overlap=None) -> BoxedFrame:
    """Labels, and (class, score, height px) of what was found, the i-th on the i-th label."""
    shared = np.zeros((len(labels), len(found), 2))
    for i in range(min(shared.shape[:2])):
        shared[i, i] = 1.0
    if overlap is not None:
        shared[:] = overlap
    names = tuple(name.lower() for name, _, _ in found)
    scores, heights = (np.array([one[k] for one in found], float) for k in (1, 2))
    return BoxedFrame(tuple(labels), names, scores, heights, shared)


def ap(frames, name="Car", difficulty="moderate", min_overlap=0.7):
    (found,) = (
        one
        for one in average_precisions(frames)
        if (one.name, one.difficulty, one.min_overlap) == (name, difficulty, min_overlap)
    )
    return found


def test_all_found_and_nothing_else_is_one() -> None:
    frames = [frame([label()], [("Car", 0.01 * i, 50.0)]) for i in range(80)]
    found = ap(frames)
    assert (found.n, found.bev, found.space) == (80, 1.0, 1.0)


def test_half_found_is_half() -> None:
    frames = [frame([label()], [("Car", 0.5 + 0.001 * i, 50.0)]) for i in range(40)]
    frames += [frame([label()], []) for _ in range(40)]
    # recalls of 1/40 to 20/40 are reached, by the devkit's rounding 19.5 of them
    assert ap(frames).bev == pytest.approx(0.5, abs=0.03)


def test_a_surer_mistake_for_each_halves_it() -> None:
    frames = [frame([label()], [("Car", 0.5, 50.0), ("Car", 0.9, 50.0)]) for _ in range(80)]
    assert ap(frames).bev == pytest.approx(0.5, abs=0.01)


def test_other_overlaps_and_views_are_told_apart() -> None:
    frames = [frame([label()], [("Car", 0.01 * i, 50.0)], (0.6, 0.4)) for i in range(80)]
    assert (ap(frames).bev, ap(frames, min_overlap=0.5).bev) == (0.0, 1.0)
    assert ap(frames, min_overlap=0.5).space == 0.0


def test_what_is_too_hard_counts_neither_way() -> None:
    good = [frame([label()], [("Car", 0.01 * i, 50.0)]) for i in range(80)]
    small = (0.0, 0.0, 60.0, 20.0)
    neither = [
        frame([label(occlusion=2)], [("Car", 0.99, 50.0)]),
        frame([label(truncation=0.4)], [("Car", 0.99, 50.0)]),
        frame([label(box_px=small)], []),
        frame([label("Van")], [("Car", 0.99, 50.0)]),
        frame([], [("Car", 0.99, 20.0)]),
        frame([], [("Pedestrian", 0.99, 50.0)]),
        frame([label(ignore=True)], []),
    ]
    assert (ap(good + neither).n, ap(good + neither).bev) == (80, 1.0)
    assert ap(good + neither, difficulty="hard").n == 82
    wrong = [frame([], [("Car", 0.99, 50.0)]), frame([label("Truck")], [("Car", 0.99, 50.0)])]
    assert ap(good + wrong).bev < 0.98


def test_one_box_is_right_once() -> None:
    twice = [frame([label()], [("Car", 0.5, 50.0), ("Car", 0.5, 50.0)], 1.0) for _ in range(80)]
    assert ap(twice).bev == pytest.approx(0.5, abs=0.01)


def test_a_class_without_labels_that_count_has_none() -> None:
    found = ap([frame([label(occlusion=3)], [("Car", 0.5, 50.0)])])
    assert (found.n, found.bev, found.space) == (0, None, None)
    assert found.as_dict()["3d"] is None
