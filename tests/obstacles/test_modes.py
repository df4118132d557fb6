"""Depth modes: surfaces behind one another are told apart, one surface stays one."""

from __future__ import annotations

import numpy as np

from pseudolidar.obstacles.modes import depth_modes

STEREO = 0.25 / 384.0  # 0.25 px of a KITTI rig


def noisy(depth_m: float, count: int, spread_m: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth = depth_m + spread_m * rng.random(count)
    return depth + STEREO * depth**2 * rng.standard_normal(count)


def modes(*surfaces: np.ndarray):
    depth = np.concatenate(surfaces)
    return depth_modes(depth, np.ones(len(depth)), STEREO)


def test_a_car_before_a_wall_is_two_modes_near_to_far() -> None:
    found = modes(noisy(35.0, 400, 2.0, 1), noisy(12.0, 600, 1.0, 2))
    assert [round(mode.weight / 100) for mode in found] == [6, 4]
    assert found[0].from_m < 12 < found[0].to_m < found[1].to_m
    assert found[0].to_m <= found[1].from_m < 35


def test_far_surfaces_within_their_noise_are_one() -> None:
    # at 60 m one sigma is 2.3 m
    assert len(modes(noisy(60.0, 300, 0.0, 3), noisy(62.0, 300, 0.0, 4))) == 1
    assert len(modes(noisy(10.0, 300, 0.0, 3), noisy(12.0, 300, 0.0, 4))) == 2


def test_a_few_stray_pixels_are_no_mode() -> None:
    found = modes(noisy(20.0, 1000, 0.5, 5), np.array([4.0, 5.0, 90.0]))
    assert len(found) == 1
    assert found[0].weight >= 1000


def test_a_single_pixel_is_a_mode() -> None:
    (found,) = modes(np.array([7.0]))
    assert found.from_m <= 7.0 <= found.to_m
