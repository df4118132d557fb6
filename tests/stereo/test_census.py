"""The census matcher: against the numpy oracle, on threads, at its limits."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.errors import StereoConfig
from pseudolidar.stereo.aggregation import Workspace, aggregate
from pseudolidar.stereo.census import _SIGMA, Census
from pseudolidar.stereo.smoothing import smoothed
from tests.stereo import census_oracle as oracle
from tests.stereo.pairs import frame, pair


@pytest.mark.parametrize(("half_range", "disparities"), [(0, 32), (0, 64), (16, 48), (48, 64)])
def test_winners_equal_the_oracle_bit_for_bit(half_range, disparities):
    left, right = pair(37, 101)
    workspace = Workspace(37, 101, disparities, half_range)
    found = aggregate(
        left, right, workspace, penalties=(9, 95), uniqueness=0.06, agreement_px=1.0, threads=1
    )
    volume = oracle.costs(left, right, workspace.bins, workspace.half_bins)
    total = oracle.sums(volume, (9, 95))
    disparity, verdict, distinct = oracle.winners(total, workspace.half_bins, 0.06, 1.0)
    np.testing.assert_array_equal(found.disparity, disparity)
    np.testing.assert_array_equal(found.verdict, verdict)
    np.testing.assert_array_equal(found.distinctness, distinct)
    assert (verdict == 2).mean() > 0.5  # the pair is one that can be matched


def test_smoothing_equals_the_oracle_bit_for_bit():
    left, right = pair(60, 120)
    workspace = Workspace(60, 120, 32, 0)
    winners = aggregate(
        left, right, workspace, penalties=(10, 95), uniqueness=0.25, agreement_px=2, threads=1
    )
    found = smoothed(winners, speckle_pixels=30, speckle_step_px=1.0)
    median = cv2.medianBlur(winners.disparity, 5)
    accepted = oracle.accepted(median, winners.verdict)
    assert accepted.sum() > (winners.verdict == 2).sum()  # something was confirmed
    valid = oracle.without_speckles(median, accepted, 1.0, 30)
    assert valid.sum() < accepted.sum()  # something was a speckle
    mean, support, same, spread = oracle.smoothed(median, valid)
    np.testing.assert_array_equal(found.disparity, mean)
    np.testing.assert_array_equal(found.support, support)
    np.testing.assert_array_equal(found.same, same)
    np.testing.assert_array_equal(found.spread, spread)
    model = _SIGMA["fast"]
    expected = oracle.sigma(mean, support, same, spread, winners.distinctness, model)
    sigma = found.with_sigma(model).sigma
    # the kernel's logarithm is good to 2e-4, of five terms with slopes up to 6
    np.testing.assert_allclose(sigma, expected, rtol=5e-3, equal_nan=True)


@pytest.mark.parametrize("quality", ["fast", "fine"])
@pytest.mark.parametrize("height", [40, 41])
def test_two_threads_give_the_same_bits(quality, height):
    one = Census(quality=quality, disparities=32).load()
    two = Census(quality=quality, disparities=32, threads=2).load()
    f = frame(*pair(height, 160))
    np.testing.assert_array_equal(one(f).values, two(f).values)
    np.testing.assert_array_equal(one(f).sigma, two(f).sigma)


def test_one_matcher_serves_many_threads_and_sizes():
    matcher = Census().load(min_depth_m=4)
    frames = [frame(*pair(40 + 4 * (i % 3), 160, seed=i)) for i in range(12)]
    alone = [Census().load(min_depth_m=4)(f).values for f in frames]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(matcher, frames))
    for a, b in zip(alone, together, strict=True):
        np.testing.assert_array_equal(a, b.values)


def test_disparity_is_right_on_a_known_shift():
    left, right = pair(120, 240, disparity=10.0)
    for quality, tolerance_px in (("fast", 0.25), ("fine", 0.2)):
        found = Census(quality=quality, disparities=32).load()(frame(left, right))
        background = found.values[90:, 40:100]
        truth = 10 + 0.05 * np.arange(90, 120)[:, None]
        assert np.isfinite(background).mean() > 0.9
        assert np.nanmedian(np.abs(background - truth)) < tolerance_px
        square = found.values[35:55, 130:170]
        assert np.nanmedian(square) == pytest.approx(10 + 6 + 0.05 * 45, abs=0.5)


def test_invalid_is_nan_in_values_and_sigma_alike():
    found = Census(disparities=32).load()(frame(*pair(60, 120)))
    assert 0 < found.density < 1
    np.testing.assert_array_equal(found.valid, np.isfinite(found.sigma))
    assert (found.values[found.valid] > 0).all()
    assert (found.sigma[found.valid] > 0).all()


@pytest.mark.parametrize("level", [0, 255])
def test_flat_images_have_no_disparity(level):
    flat = np.full((60, 120), level, np.uint8)
    assert Census(disparities=32).load()(frame(flat, flat)).density == 0


def test_sixteen_bits_and_colour_match_like_grey():
    left, right = pair(60, 160)
    grey = Census(disparities=32).load()(frame(left, right)).values
    deep = frame(left.astype(np.uint16) * 257, right.astype(np.uint16) * 257)
    np.testing.assert_array_equal(Census(disparities=32).load()(deep).values, grey)
    colour = frame(np.dstack([left] * 3), np.dstack([right] * 3))
    np.testing.assert_array_equal(Census(disparities=32).load()(colour).values, grey)


def test_exposure_differences_do_not_matter():
    left, right = pair(60, 160)
    gamma = (255 * (right / 255.0) ** 0.7).astype(np.uint8)
    grey = Census(disparities=32).load()(frame(left, right))
    bent = Census(disparities=32).load()(frame(left, gamma))
    both = grey.valid & bent.valid
    assert both.mean() > 0.9 * grey.density
    assert np.median(np.abs(grey.values - bent.values)[both]) < 0.1


def test_matcher_is_picklable_and_leaves_its_memory_behind():
    matcher = Census(disparities=64).load()
    f = frame(*pair(60, 160))
    matcher(f)
    packed = pickle.dumps(matcher)
    assert len(packed) < 2000
    np.testing.assert_array_equal(pickle.loads(packed)(f).values, matcher(f).values)


def test_range_comes_from_the_nearest_depth():
    f = frame(*pair(40, 400), focal_px=200, baseline_m=0.5)  # f B = 100 px m
    workspaces = []
    for depth_m in (3.0, 1.0, 0.1):
        matcher = Census().load(min_depth_m=depth_m)
        matcher(f)
        workspaces.append(matcher._spare[0].bins)
    assert workspaces == [32, 96, 192]  # 33 -> 32, 100 -> 96, never above half the width


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"disparities": 50}, ("50", "multiple of 32", "32 or 64")),
        ({"disparities": 0}, ("0", "multiple of 32")),
        ({"disparities": -32}, ("-32",)),
        ({"penalty_small": 95}, ("small < large",)),
        ({"penalty_large": 200}, ("95",)),
        ({"uniqueness_percent": 100.0}, ("0 to 99",)),
    ],
)
def test_illegal_settings_are_named_with_legal_ones(settings, words):
    with pytest.raises(StereoConfig) as error:
        Census(**settings)
    assert all(word in str(error.value) for word in words)
    assert error.value.exit_code == 3


def test_range_wider_than_the_image_is_refused_with_the_largest():
    f = frame(*pair(40, 100))
    with pytest.raises(StereoConfig, match="at most 96"):
        Census(disparities=128).load()(f)
    with pytest.raises(StereoConfig, match="at least 64 px"):
        Census().load()(frame(*pair(40, 60)))


def test_sizes_that_fit_no_vector():
    for height, width in ((1, 65), (2, 64), (7, 97)):
        left, right = pair(height, width)
        found = Census(disparities=32).load()(frame(left, right))
        assert found.values.shape == (height, width)


def test_settings_can_be_replaced():
    assert replace(Census(), quality="fine").small == 7
    assert Census(penalty_small=5).small == 5
