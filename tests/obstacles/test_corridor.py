"""The corridor ahead: what stands in it is told; what is beside, low or flickers is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.obstacles.corridor import Ahead, Corridor, approach, near_mask, nearest_ahead
from tests.obstacles.scene import sight

CORRIDOR = Corridor.parse("2x2x30")
POST = ("post", 0.3, 8.0, 0.3, 1.5)


def test_the_nearest_thing_in_it_counts_whatever_it_is() -> None:
    found = nearest_ahead(sight((POST, ("Car", 0.0, 15.0, 1.65, 1.5))), CORRIDOR)
    assert abs(found.distance_m - 8.0) < 2 * found.sigma_m + 0.1
    assert found.across_m == pytest.approx(0.3, abs=0.1)
    assert found.points > 100


@pytest.mark.parametrize(
    "thing",
    [
        ("beside", 2.0, 8.0, 0.5, 1.5),
        ("kerb", 0.0, 8.0, 1.0, 0.15),
        ("far", 0.0, 35.0, 1.65, 1.5),
    ],
)
def test_what_is_not_in_the_way_is_not_told(thing) -> None:
    assert nearest_ahead(sight((thing,)), CORRIDOR) is None


def test_single_pixels_are_nothing() -> None:
    seen = sight(())
    rng = np.random.default_rng(1)
    seen.depth.values[rng.integers(60, 120, 30), rng.integers(280, 360, 30)] = rng.uniform(
        2, 25, 30
    )
    assert nearest_ahead(seen, CORRIDOR) is None


def test_without_a_ground_the_corridor_lies_about_the_camera() -> None:
    # 1.5 m high from the floor 1.6 m below: it reaches up to 0.1 m below the camera
    assert nearest_ahead(sight((POST,), ground=False), Corridor(2, 1.0, 9)) is not None
    assert nearest_ahead(sight((POST,), ground=False), Corridor(2, 0.1, 9)) is None


def test_how_sure_it_is_nearer() -> None:
    ahead = Ahead(3.0, 0.5, 100, 0.0, 0.0)
    assert ahead.nearer_than(3.0) == 0.5
    assert ahead.nearer_than(3.5) == pytest.approx(0.8413, abs=1e-3)
    assert ahead.nearer_than(1.0) < 1e-3


def run_at(speed_m_s: float, sigma_m: float, seed: int, frames: int = 6):
    rng = np.random.default_rng(seed)
    times = [1e9 + 0.1 * i for i in range(frames)]
    distances = [
        20.0 - speed_m_s * 0.1 * i + sigma_m * rng.standard_normal() for i in range(frames)
    ]
    return approach(times, [Ahead(float(d), sigma_m, 50, 0.0, 0.0) for d in distances])


def test_the_speed_of_an_approach_has_the_error_it_tells() -> None:
    found = [run_at(8.0, 0.3, seed) for seed in range(100)]
    off = [(one.closing_m_s - 8.0) / one.sigma_m_s for one in found]
    assert 0.55 < np.mean(np.abs(off) < 1) < 0.8
    sure = run_at(8.0, 0.01, 1)
    assert sure.contact_s == pytest.approx(16.0 / 8.0, rel=0.02)
    assert sure.sigma_contact_s < 0.1
    assert run_at(-5.0, 0.1, 1).contact_s is None


def test_an_approach_needs_the_same_thing_in_three_frames() -> None:
    far, near = Ahead(30.0, 0.1, 50, 0, 0), Ahead(10.0, 0.1, 50, 0, 0)
    times = [0.1 * i for i in range(4)]
    assert approach(times, [far, far, near, near]) is None
    assert approach(times, [far, None, near, near]) is None
    assert approach(times, [far, near, near, near]).closing_m_s == pytest.approx(0.0)
    assert approach([0.0, 0.0, 0.0], [near] * 3) is None
    assert approach([], []) is None


def test_near_things_are_masked_but_not_the_ground() -> None:
    mask = near_mask(sight((POST,)), 9.0)
    assert set(np.unique(mask)) == {0, 255}
    left, right = (round(400 * (0.3 + side * 0.15) / 8 + 319.5) for side in (-1, 1))
    assert (mask[110:150, left : right + 1] == 255).mean() > 0.95
    assert not mask[200:].any()


@pytest.mark.parametrize("text", ["2x2", "2x2x0", "2x-1x3", "axbxc", "", "2x2x30x1", "infx1x1"])
def test_a_corridor_is_three_lengths(text: str) -> None:
    with pytest.raises(UsageError, match="2x2x30"):
        Corridor.parse(text)
    assert str(Corridor.parse("2.5X2x30")) == "2.5x2x30"
    assert math.isfinite(Corridor.parse("2x2x1e2").length_m)
