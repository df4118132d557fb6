"""Clouds as pictures."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.cloud_views import (
    WAY_MARGIN_M,
    WAY_RGB,
    Eye,
    from_above,
    perspective,
)
from pseudolidar.evaluation.pictures import NOTHING
from pseudolidar.evaluation.splat_kernel import splat
from pseudolidar.structures.cloud import PointCloud

EYE = Eye((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), width_px=101, height_px=51, angle_deg=90.0)
RED, BLUE = (255, 0, 0), (0, 0, 255)


def cloud(xyz: list[tuple[float, float, float]], rgb: list[tuple[int, int, int]]) -> PointCloud:
    return PointCloud(np.array(xyz, np.float32), "map", rgb=np.array(rgb, np.uint8))


def test_the_nearest_point_is_in_front_whatever_their_order():
    far, near = (20.0, 0.0, 0.0), (10.0, 0.0, 0.0)
    for xyz, rgb in (([far, near], [BLUE, RED]), ([near, far], [RED, BLUE])):
        picture = perspective(cloud(xyz, rgb), EYE, point_m=0.01)
        assert tuple(picture[25, 50]) == RED
        assert (picture != NOTHING).any(axis=2).sum() == 1


def test_left_is_left_and_up_is_up():
    picture = perspective(cloud([(10, 5, 2)], [RED]), EYE, point_m=0.01)
    ((row, column),) = np.argwhere((picture == RED).all(axis=2))
    # Focal length 50.5 px: half the width over tan 45 degrees.
    assert (row, column) == (int(25.5 - 2 / 10 * 50.5), int(50.5 - 5 / 10 * 50.5))


def test_points_are_as_large_as_they_are_up_to_the_largest():
    def side(at_m: float, largest_px: int) -> float:
        seen = perspective(cloud([(at_m, 0, 0)], [RED]), EYE, point_m=1.0, largest_px=largest_px)
        return float(np.sqrt((seen == RED).all(axis=2).sum()))

    assert [side(at_m, 9) for at_m in (100.0, 20.0, 10.0, 2.0)] == [1, 3, 6, 9]
    assert side(2.0, 4) == 4


def test_nothing_behind_the_eye_or_beside_it_is_seen():
    away = [(-5.0, 0.0, 0.0), (0.2, 0.0, 0.0), (1.0, 1e9, 0.0), (1.0, 0.0, -1e30)]
    assert (perspective(cloud(away, [RED] * 4), EYE, point_m=1.0) == NOTHING).all()


def test_from_above_the_highest_is_in_front():
    picture, per_px = from_above(
        cloud([(0, 0, 5), (0, 0, 1), (10, 10, 0)], [RED, BLUE, BLUE]), point_m=0.5, width_px=100
    )
    assert tuple(picture[-1, 0]) == RED
    assert per_px == pytest.approx(0.1, rel=0.01)


def test_the_kernel_draws_as_plain_python_does():
    rng = np.random.default_rng(3)
    count, shape = 300, (20, 30)
    u, v = rng.uniform(-4, 34, count), rng.uniform(-4, 24, count)
    nearness, sides = rng.integers(0, 9, count).astype(float), rng.integers(1, 6, count)
    rgb = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    picture, front = np.zeros((*shape, 3), np.uint8), np.full(shape, -np.inf)
    splat(picture, front, u, v, nearness, sides, rgb)
    plain = np.zeros((*shape, 3), np.uint8)
    for i in np.argsort(nearness, kind="stable"):
        top, left = int(np.floor(v[i])) - sides[i] // 2, int(np.floor(u[i])) - sides[i] // 2
        rows, columns = slice(max(top, 0), top + sides[i]), slice(max(left, 0), left + sides[i])
        if top + sides[i] > 0 and left + sides[i] > 0:
            plain[rows, columns] = rgb[i]
    assert np.array_equal(picture, plain)


def test_gaps_between_points_from_above_are_filled_from_beneath():
    places = [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.1, 5.0)]
    seen = cloud(places, [RED, BLUE, RED, BLUE, BLUE])
    plain, per_px = from_above(seen, point_m=0.01, width_px=100)
    filled, _ = from_above(seen, point_m=0.01, gap_m=0.3, width_px=100)
    assert per_px == pytest.approx(0.01, rel=0.01)
    assert [tuple(plain[-1, column]) == NOTHING for column in (0, 10, 20, 30)] == [0, 1, 1, 0]
    row = [tuple(filled[-1, column]) for column in (0, 10, 20, 30, 80)]
    assert row == [RED, RED, BLUE, BLUE, NOTHING]
    # A square that fills covers no point: this one is of the highest.
    near = cloud([*places, (0.1, 0.1, 9.0)], [RED, BLUE, RED, BLUE, BLUE, BLUE])
    filled, _ = from_above(near, point_m=0.01, gap_m=0.3, width_px=100)
    assert [tuple(filled[-1, column]) for column in (0, 10)] == [RED, BLUE]


def test_a_way_is_in_view_and_begins_with_a_dot():
    way = np.array([[-4.0, 0.0], [5.0, 0.0]])
    seen = cloud([(0, -1, 0), (10, 1, 0)], [RED, RED])
    picture, per_px = from_above(seen, point_m=0.05, way=way, width_px=150)
    assert per_px == pytest.approx(14.5 / 150, rel=0.01)
    orange = (picture == WAY_RGB).all(axis=2)
    columns = np.flatnonzero(orange.any(axis=0)) * per_px - 4.0 - WAY_MARGIN_M
    assert columns.min() == pytest.approx(-4.5, abs=0.25)
    assert columns.max() == pytest.approx(5.0, abs=0.35)
    tall = orange.sum(axis=0)
    assert tall[int((WAY_MARGIN_M) / per_px)] > 2 * np.median(tall[tall > 0])
