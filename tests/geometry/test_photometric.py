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
