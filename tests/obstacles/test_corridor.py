"""The corridor ahead: what stands in it is told; what is beside, low or flickers is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.obstacles.approach import FRAMES, Nearing, approach
from pseudolidar.obstacles.corridor import (
    STOP_CHANCE,
    Ahead,
    Corridor,
    StopRule,
    near_mask,
    nearest_ahead,
)
from pseudolidar.obstacles.corridor_view import CorridorView, corridor_view
from pseudolidar.obstacles.sight import Sight
from pseudolidar.running.products.corridor_table import encode_corridor, view_figures, watched
from pseudolidar.structures.disparity import DepthMap
from tests.obstacles.scene import EYE_HEIGHT_M, sight

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


def test_while_frames_come_an_approach_is_that_of_the_last_ones() -> None:
    rng = np.random.default_rng(3)
    times = [0.1 * i for i in range(FRAMES + 4)]
    seen = [Ahead(20 - 8 * t + 0.1 * rng.standard_normal(), 0.1, 50, 0, 0) for t in times]
    seen[1] = None
    nearing = Nearing()
    told = [nearing(time_s, ahead) for time_s, ahead in zip(times, seen, strict=True)]
    assert told == [approach(times[: i + 1], seen[: i + 1]) for i in range(len(times))]
    assert told[3:5] == [None, approach(times[2:5], seen[2:5])]
    assert told[-1] == approach(times[-FRAMES:], seen[-FRAMES:])


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


def blind(one: Sight, rows: slice, columns: slice) -> Sight:
    depth = one.depth.values.copy()
    depth[rows, columns] = np.nan
    return replace(one, depth=DepthMap(depth, one.depth.sigma))


def test_a_corridor_in_which_nothing_could_be_matched_is_not_free() -> None:
    everything = slice(None), slice(None)
    seen = corridor_view(sight(()), CORRIDOR)
    assert (seen.state, seen.seen) == ("free", 1.0)
    assert corridor_view(blind(sight(()), *everything), CORRIDOR) == CorridorView(None, 0.0)
    assert corridor_view(blind(sight(()), *everything), CORRIDOR).state == "unseen"
    # Pixels from 8 m on where the corridor is: few, but most of its volume lies behind them.
    beyond = slice(99, 99 + round(400 * EYE_HEIGHT_M / 8)), slice(270, 370)
    found = corridor_view(blind(sight(()), *beyond), CORRIDOR)
    assert found.state == "unseen"
    assert (beyond[0].stop - 99) * 100 < 0.2 * 140 * 640
    beside = slice(None), slice(0, 100)
    assert corridor_view(blind(sight(()), *beside), CORRIDOR).state == "free"
    assert corridor_view(sight((POST,)), CORRIDOR).state == "thing"


def test_depths_without_sigma_are_not_sure() -> None:
    told = sight((POST,))
    untold = replace(told, depth=DepthMap(told.depth.values))
    found, sure = nearest_ahead(untold, CORRIDOR), nearest_ahead(told, CORRIDOR)
    assert found.distance_m == pytest.approx(sure.distance_m, abs=0.1)
    assert found.sigma_m > 0.09  # 0.3 px at 8 m with 200 px m; nothing is gained by many pixels
    assert 0.5 < found.nearer_than(8.1) < 0.95


def test_a_vehicle_stops_where_something_may_well_be_too_near() -> None:
    rule = StopRule(3.0, STOP_CHANCE)
    assert not rule.broken_by(None)
    assert not rule.broken_by(Ahead(3.6, 0.5, 100, 0.0, 0.0))
    assert rule.broken_by(Ahead(3.45, 0.5, 100, 0.0, 0.0))
    assert not StopRule(3.0, 0.5).broken_by(Ahead(3.01, 0.5, 100, 0.0, 0.0))
    assert rule.broken_by(Ahead(4.0, 0.05, 100, 0.0, 0.0, bound=True))  # it may be anywhere nearer


def test_what_stands_where_the_search_ends_may_be_nearer() -> None:
    seen = replace(sight((POST,)), searched_px=25)  # 8 m is 25 px
    assert nearest_ahead(seen, CORRIDOR).bound
    assert not nearest_ahead(replace(seen, searched_px=64), CORRIDOR).bound
    assert not nearest_ahead(sight((POST,)), CORRIDOR).bound


def test_rows_of_skipped_frames_and_of_frames_without_a_time() -> None:
    ahead = [CorridorView(Ahead(20.0 - i, 0.1, 50, 0.0, 0.0), 0.9) for i in range(4)]
    frames = [(f"{i}", 0.1 * i, view_figures(view)) for i, view in enumerate(ahead)]
    frames.insert(2, ("bad", 0.15, {}))
    frames.insert(0, ("no pair", None, {}))
    rows = watched(frames)
    assert [one.state for one in rows] == ["skipped", *["thing"] * 2, "skipped", *["thing"] * 2]
    assert rows[-1].approach.closing_m_s == pytest.approx(10.0)
    lines = encode_corridor(rows).decode().splitlines()
    assert lines[1].startswith("no pair,,skipped,,")
    assert lines[2].startswith("0,0,thing,0.9000,20,0.1,50,0,0,0,")
    assert {line.count(",") for line in lines} == {lines[0].count(",")}
