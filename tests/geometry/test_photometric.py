from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.photometric import (
    PhotometricDifference,
    fit_difference,
    radius2_of,
)
from tests.exposed import exposed


def seen(gain, gamma, vignetting, *, noise=0.01, wrong=0.1, n=4000):
    rng = np.random.default_rng(3)
    left = rng.uniform(0.03, 0.9, (n, len(gain)))
    radius2 = rng.uniform(0, 1, n)
    right = np.array(gain) * left**gamma * np.exp(vignetting * radius2)[:, None]
    right[: int(wrong * n)] = rng.uniform(0.03, 0.9, (int(wrong * n), len(gain)))
    left += rng.normal(0, noise, left.shape)
    return left, right + rng.normal(0, noise, right.shape), radius2


@pytest.mark.parametrize(
    ("gain", "gamma", "vignetting"),
    [
        ((1.0, 1.0, 1.0), 1.0, 0.0),
        ((0.6, 0.6, 0.6), 1.0, 0.0),
        ((1.2, 1.0, 0.8), 1.4, -0.4),
        ((0.9,), 0.6, 0.3),
    ],
)
def test_what_was_put_on_is_found_among_noise_and_wrong_matches(gain, gamma, vignetting):
    found = fit_difference(*seen(gain, gamma, vignetting))
    assert found.gain == pytest.approx(gain, rel=0.03)
    assert found.gamma == pytest.approx(gamma, abs=0.03)
    assert found.vignetting == pytest.approx(vignetting, abs=0.04)


def test_one_brightness_tells_a_gain_and_no_gamma():
    rng = np.random.default_rng(0)
    left = 0.5 + rng.normal(0, 0.002, (500, 1))
    right = 0.4 + rng.normal(0, 0.002, (500, 1))
    found = fit_difference(left, right, np.full(500, 0.2))
    assert found.gamma == pytest.approx(1.0, abs=0.2)
    assert found.seen(0.5, 0.2) == pytest.approx([0.4], abs=0.01)


def test_clipped_points_tell_nothing():
    left, right, radius2 = seen((1.0,), 1.0, 0.0, n=400)
    assert fit_difference(left, np.ones_like(right), radius2) is None
    assert fit_difference(left[:30], right[:30], radius2[:30]) is None


@pytest.mark.parametrize(("dtype", "channels"), [(np.uint8, 3), (np.uint16, 3), (np.uint8, 0)])
def test_undone_is_what_the_left_eye_saw(dtype, channels):
    white = np.iinfo(dtype).max
    shape = (60, 90, channels) if channels else (60, 90)
    left = (np.random.default_rng(1).uniform(0.1, 0.6, shape) * white).astype(dtype)
    right = exposed(left, gain=0.8, gamma=1.3, vignetting=-0.4)
    difference = PhotometricDifference((0.8,) * max(1, channels), 1.3, -0.4)
    back = difference.undone(right)
    assert (back.dtype, back.shape) == (left.dtype, left.shape)
    off = np.abs(back.astype(float) - left) / white
    assert off.max() < 0.02  # a level of a dark pixel is worth several there
    assert right.mean() < 0.8 * left.mean()


def test_radius_is_one_in_the_corners_and_nothing_in_the_middle():
    radius2 = radius2_of((51, 101))
    assert radius2[0, 0] == pytest.approx(1.0)
    assert radius2[25, 50] == pytest.approx(0.0, abs=1e-6)


def test_the_largest_difference_counts_colours_and_corners():
    none = PhotometricDifference((1.0, 1.0, 1.0), 1.0, 0.0)
    assert none.largest == pytest.approx(0.0, abs=1e-9)
    for other in (
        PhotometricDifference((1.0, 1.0, 0.9), 1.0, 0.0),
        PhotometricDifference((1.0, 1.0, 1.0), 1.2, 0.0),
        PhotometricDifference((1.0, 1.0, 1.0), 1.0, -0.2),
    ):
        assert other.largest > 0.03


def test_noise_of_the_left_eye_does_not_make_gamma_smaller():
    """A slope fitted one way is drawn towards 0 by noise of what it is fitted against."""
    rng = np.random.default_rng(0)
    level = rng.uniform(0.4, 0.6, (4000, 1))
    left, right = level + rng.normal(0, 0.03, (2, 4000, 1))
    found = fit_difference(left, 0.8 * right, np.full(4000, 0.2))
    assert found.gamma == pytest.approx(1.0, abs=0.03)


def test_what_clips_the_right_eye_makes_its_gain_no_smaller():
    left, right, radius2 = seen((1.8,), 1.0, 0.0, noise=0.05, wrong=0.0)
    found = fit_difference(np.maximum(left, 1e-3), np.clip(right, 1e-3, 1), radius2)
    assert found.seen(0.35)[0] / 0.35 == pytest.approx(1.8, rel=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_one_brightness_tells_no_gamma_whatever_the_noise(seed: int):
    noise = np.random.default_rng(seed).normal(0, 0.002, (2, 500, 1))
    left, right = np.array([[[0.5]], [[0.4]]]) + noise
    found = fit_difference(left, right, np.full(500, 0.2))
    assert found.gamma == pytest.approx(1.0, abs=0.1)
    assert found.seen(0.5, 0.2) == pytest.approx([0.4], abs=0.001)


def test_both_eyes_are_clipped_where_either_is():
    levels = np.arange(256, dtype=np.uint8)[None, :].repeat(2, axis=0)
    twice = PhotometricDifference((2.0,), 1.0, 0.0)  # the right eye is white from 128 on
    left, right = twice.clipped_alike(levels, levels)
    np.testing.assert_array_equal(left, np.minimum(levels, int(0.97 / 2 * 255)))
    np.testing.assert_array_equal(right, levels)
    half = PhotometricDifference((0.5,), 1.0, 0.0)
    left, right = half.clipped_alike(levels, levels)
    np.testing.assert_array_equal(left, levels)
    np.testing.assert_array_equal(right, np.minimum(levels, int(0.97 / 2 * 255)))


def test_nothing_is_brighter_than_white():
    bright = PhotometricDifference((1.6,), 1.0, 0.0)
    assert bright.largest == pytest.approx(0.6 * 0.55)  # 0.75 would become 1.2, and is white
