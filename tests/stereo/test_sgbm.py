"""OpenCV's matchers behind our protocol: right disparities, refusals before native code."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.errors import StereoConfig, StructureError
from pseudolidar.stereo.sgbm import Bm, Sgbm
from tests.stereo.pairs import frame, pair

MODES = ("3way", "sgbm", "hh", "hh4")
MATCHERS = [*(Sgbm(mode=mode, disparities=32) for mode in MODES), Bm(disparities=32)]
BACKGROUND = slice(95, 115), slice(50, 110)  # of a pair of 120 x 240
TRUTH_PX = 10 + 0.05 * np.arange(95, 115)[:, None]


@pytest.fixture(scope="module")
def known():
    return frame(*pair(120, 240, disparity=10.0))


@pytest.mark.parametrize("right_matcher", [False, True])
@pytest.mark.parametrize("matcher", MATCHERS)
def test_disparity_is_right_on_a_known_shift(known, matcher, right_matcher):
    found = replace(matcher, right_matcher=right_matcher).load()(known)
    assert found.sigma is None
    assert found.values.dtype == np.float32
    background = found.values[BACKGROUND]
    assert np.isfinite(background).mean() > 0.8
    assert np.nanmedian(np.abs(background - TRUTH_PX)) < 0.3
    assert np.nanmedian(found.values[35:55, 130:170]) == pytest.approx(18.25, abs=0.6)


@pytest.mark.parametrize("matcher", MATCHERS)
def test_unknown_is_nan_never_zero_or_negative(known, matcher):
    found = matcher.load()(known)
    assert 0.3 < found.density < 1
    assert (found.values[found.valid] > 0).all()
    assert not np.isinf(found.values).any()


@pytest.mark.parametrize("kind", [Sgbm, Bm])
def test_a_right_matcher_refuses_what_the_eyes_do_not_agree_on(kind):
    """Pictures of different places: the left finds a best match everywhere, none is true."""
    strangers = frame(pair(80, 160, seed=1)[0], pair(80, 160, seed=2)[1])
    bare = kind(disparities=32, agreement_px=-1, uniqueness_percent=0, speckle_pixels=0)
    checked = replace(bare, right_matcher=True, agreement_px=1)
    before, after = bare.load()(strangers), checked.load()(strangers)
    assert before.density > 0.4
    assert after.density < 0.6 * before.density
    assert not (after.valid & ~before.valid).any()


def test_the_modes_differ(known):
    maps = [Sgbm(mode=mode, disparities=32).load()(known).values for mode in MODES]
    distinct = {np.nan_to_num(values).tobytes() for values in maps}
    assert len(distinct) == len(MODES)


@pytest.mark.parametrize("settings", [Sgbm(), Sgbm(mode="hh", right_matcher=True), Bm()])
def test_one_matcher_serves_many_threads_and_sizes(settings):
    matcher = settings.load(min_depth_m=4)
    frames = [frame(*pair(40 + 4 * (i % 3), 160, seed=i)) for i in range(8)]
    alone = [settings.load(min_depth_m=4)(f).values for f in frames]
    with ThreadPoolExecutor(4) as pool:
        for values, found in zip(alone, pool.map(matcher, frames), strict=True):
            np.testing.assert_array_equal(found.values, values)


@pytest.mark.parametrize("settings", [Sgbm(disparities=32), Bm(disparities=32)])
def test_sixteen_bits_and_colour_match_like_grey(known, settings):
    matcher = pickle.loads(pickle.dumps(settings.load()))
    grey = matcher(known).values
    deep = frame(known.left.astype(np.uint16) * 16, known.right.astype(np.uint16) * 16)
    np.testing.assert_array_equal(matcher(deep).values, grey)
    colour = frame(np.dstack([known.left] * 3), np.dstack([known.right] * 3))
    np.testing.assert_array_equal(matcher(colour).values, grey)


@pytest.mark.parametrize("channels", [2, 4, 5])
def test_other_numbers_of_channels_never_reach_opencv(channels, monkeypatch):
    """StereoSGBM takes them and gives nonsense."""
    monkeypatch.setattr(cv2.StereoSGBM, "create", lambda **_: pytest.fail("reached OpenCV"))
    left, right = (np.dstack([image] * channels) for image in pair(40, 160))
    with pytest.raises(StructureError):
        Sgbm(disparities=32).load()(frame(left, right))


@pytest.mark.parametrize(
    ("kind", "settings", "words"),
    [
        (Sgbm, {"disparities": 50}, ("disparities 50", "multiple of 16", "48 or 64")),
        (Sgbm, {"disparities": 0}, ("disparities 0", "multiple of 16")),
        (Sgbm, {"disparities": -16}, ("disparities -16",)),
        (Sgbm, {"block_size": 4}, ("block_size 4", "odd", "such as 5")),
        (Sgbm, {"block_size": -1}, ("block_size -1", "such as 1")),
        (Sgbm, {"p1": 200, "p2": 200}, ("p1 = 200", "p1 < p2", "200 and 800")),
        (Sgbm, {"p1": 0}, ("p1 = 0",)),
        (Bm, {"disparities": 40}, ("disparities 40", "32 or 48")),
        (Bm, {"block_size": 3}, ("block_size 3", "from 5 to 255")),
        (Bm, {"block_size": 14}, ("such as 15",)),
        (Bm, {"block_size": 257}, ("block_size 257", "255")),
        (Bm, {"pre_filter_cap": 64}, ("pre_filter_cap 64", "1 to 63")),
    ],
)
def test_illegal_settings_are_named_with_legal_ones(kind, settings, words):
    with pytest.raises(StereoConfig) as error:
        kind(**settings)
    assert all(word in str(error.value) for word in words), str(error.value)
    assert error.value.where
    assert error.value.exit_code == 3


@pytest.mark.parametrize("kind", [Sgbm, Bm])
def test_a_range_as_wide_as_the_image_is_refused_with_the_largest(kind):
    with pytest.raises(StereoConfig, match="at most 144") as error:
        kind(disparities=160).load()(frame(*pair(40, 160)))
    assert "--matcher.disparities" in error.value.fix


def test_a_window_larger_than_the_image_is_refused():
    with pytest.raises(StereoConfig, match="to 39"):
        Bm(disparities=32, block_size=41).load()(frame(*pair(40, 160)))


@pytest.mark.parametrize("settings", [Sgbm(), Bm()])
def test_flat_images_have_no_disparity(settings):
    flat = np.full((60, 120), 128, np.uint8)
    assert settings.load(min_depth_m=4)(frame(flat, flat)).density < 0.02
