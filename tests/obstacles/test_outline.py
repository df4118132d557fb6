"""A plain thing of one colour is as far away as its edges say, whatever is behind it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.geometry.box_in_view import across_m
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.hues import Hues
from pseudolidar.obstacles.measure import measured
from pseudolidar.obstacles.outline import outline_depth
from tests.benchmarks.targets import Row, measured_targets
from tests.obstacles.scene import BASELINE_M, FOCAL_PX, HEIGHT, WIDTH, sight

PURPLE = Colour(Hues.parse("270-310"), least_pixels=6, opening=1)
FINE = 8  # steps of a pixel


def eye(left_px: float, width_px: float, shift_px: int, seed: int) -> np.ndarray:
    """A purple square before books, blurred by the pixels alone, with noise."""
    rng = np.random.default_rng(7)
    books = np.repeat(rng.uniform((60, 100, 30), (220, 220, 90), (1, WIDTH // 9, 3)), 10, axis=1)
    books = books[:, shift_px : shift_px + WIDTH]
    fine = np.repeat(np.repeat(books, HEIGHT, axis=0), FINE, axis=1)
    first, last = (round(FINE * (edge + 0.5)) for edge in (left_px, left_px + width_px))
    fine[100 : 100 + round(width_px), first:last] = (105, 40, 120)
    picture = fine.reshape(HEIGHT, WIDTH, FINE, 3).mean(axis=2)
    noise = np.random.default_rng(seed).standard_normal(picture.shape)
    return np.clip(np.rint(picture + noise), 0, 255).astype(np.uint8)


def seen(disparity_px: float, width_px: float, seed: int = 0):
    left = eye(300.25, width_px, 0, seed)
    right = eye(300.25 - disparity_px, width_px, 3, seed + 1)
    return replace(sight(()), image=left, right=right)


@pytest.mark.parametrize("disparity_px", [4.5, 11.625, 23.25])
@pytest.mark.parametrize("width_px", [7.0, 22.0])
def test_a_plain_thing_is_told_by_its_edges(disparity_px: float, width_px: float) -> None:
    one = seen(disparity_px, width_px)
    (detection,) = PURPLE.load()(one)
    found = outline_depth(one, detection)
    assert FOCAL_PX * BASELINE_M / found.depth_m == pytest.approx(disparity_px, abs=0.15)
    (obstacle,) = measured(one, [detection])
    assert obstacle.measured_by == "patch"
    assert obstacle.distance_m == found.depth_m


def test_what_is_not_seen_twice_has_no_distance() -> None:
    one = seen(8.0, 12.0)
    (detection,) = PURPLE.load()(one)
    assert outline_depth(replace(one, right=None), detection) is None
    assert outline_depth(replace(one, right=eye(500.0, 12.0, 3, 1)), detection) is None
    assert outline_depth(one, replace(detection, mask=None)) is None
    assert outline_depth(seen(4.0, 3.0), PURPLE.load()(seen(4.0, 3.0))[0]) is None


def test_the_target_of_the_bench_is_found_by_its_colour() -> None:
    """One distance of `python -m tests.benchmarks.targets 20 colour`."""
    found = measured_targets(0, "colour", (2.0,))[2.0]
    assert found.distance_m == pytest.approx(2.0, rel=0.02)
    assert across_m(found.box) == pytest.approx(0.13, rel=0.04)


def test_what_is_wanted_of_the_bench_table():
    """The thesis' error beaten where it exceeds 1 %, else 1 % held; 3 % at the end."""
    wanted = [Row(d, (), theirs_m, None).wanted_m for d, theirs_m in ((4, 0.01), (8, 0.4), (12, 3))]
    assert wanted == pytest.approx([0.04, 0.4, 0.36])
    assert not Row(4.0, (), 0.01, None).holds
