"""`--balance`: costs that care for brightness see alike eyes."""

from __future__ import annotations

import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.evaluation.disparity import disparity_errors
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.balance import BalancedMatcher, balanced, clipped_share, measured
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from tests.exposed import CASES, exposed


@pytest.fixture(scope="module")
def pair():
    return Synthetic("room", frames=1, seed=3, width_px=400).open().load(0)


def badly(pair, name):
    return replace(pair, right=exposed(pair.right, **CASES[name]))


def test_the_difference_that_was_put_on_is_measured(pair):
    scout = Census().load(min_depth_m=1.0)
    own, found = measured(pair, scout), measured(badly(pair, "together"), scout)
    assert found.gamma / own.gamma == pytest.approx(1.3, abs=0.05)
    assert found.vignetting - own.vignetting == pytest.approx(-0.3, abs=0.05)
    for gain, before, put_on in zip(found.gain, own.gain, (0.84, 0.7, 0.583), strict=True):
        assert gain / before**1.3 == pytest.approx(put_on, rel=0.06)


def test_light_is_compared_at_what_both_eyes_see():
    """A wall 60 px of disparity away that grows brighter to the right; the right corners darken."""
    width, height, near_px = 400, 200, 60
    rng = np.random.default_rng(4)
    texture = cv2.resize(rng.uniform(0.7, 1, (height // 4, width // 4)), (width + near_px, height))
    ramp = np.linspace(50, 240, width + near_px)
    wall = (texture * ramp).astype(np.uint8)
    left, right = wall[:, :width].copy(), wall[:, near_px:].copy()
    K = np.array([[200.0, 0, 199.5], [0, 200.0, 99.5], [0, 0, 1]])
    flat = (Camera(K, width, height), Camera(K, width, height, frame="camera_right"))
    rig = StereoRig(
        *flat, Pose.from_rotation("camera_right", "camera_left", np.eye(3), [-0.5, 0, 0])
    )
    scout = Census().load(min_depth_m=1.2)
    seen = StereoFrame(left, exposed(right, vignetting=-0.5), rig, "wall", 0, 1)
    found = measured(seen, scout)
    assert found.gain[0] == pytest.approx(1.0, abs=0.03)
    assert found.gamma == pytest.approx(1.0, abs=0.03)
    assert found.vignetting == pytest.approx(-0.5, abs=0.03)


def found_px(matcher, pair):
    """Share of the pixels whose disparity is found to one pixel."""
    errors = disparity_errors(matcher(pair), pair.truth)
    return (errors.matched - errors.bad[0]) / errors.truth


@pytest.mark.parametrize("name", ["gain 0.6", "gamma 0.6", "together"])
def test_sgbm_finds_what_it_would_have_found(pair, name):
    usual = found_px(Sgbm().load(min_depth_m=1.0), pair)
    worse, better = (
        found_px(balanced(Sgbm(), when, min_depth_m=1.0), badly(pair, name))
        for when in ("never", "auto")
    )
    assert worse < usual - 0.008
    assert better > usual - 0.002


def test_census_does_not_care_and_needs_no_balance(pair):
    matcher = balanced(Census(), "auto", min_depth_m=1.0)
    usual = disparity_errors(matcher(pair), pair.truth)
    for name in CASES:
        if name not in ("gain 1.4", "red 1.4, blue 0.71", "red 0.71, blue 1.4"):  # clipped
            bad = badly(pair, name)
            assert matcher.balanced(bad) is bad
        found = disparity_errors(matcher(badly(pair, name)), pair.truth)
        assert found.d1_est < usual.d1_est + 0.005, name


def test_what_one_eye_is_too_bright_for_has_no_texture_in_both():
    pair = Synthetic("street", frames=1, seed=3, width_px=400).open().load(0)
    bright = badly(pair, "gain 1.4")
    assert clipped_share(bright.right) > clipped_share(pair.left) + 0.05
    seen = balanced(Census(), "auto").balanced(bright)
    np.testing.assert_array_equal(seen.left[pair.left < 150], pair.left[pair.left < 150])
    assert seen.left.max() < 200
    plain, helped = (balanced(Census(), when) for when in ("never", "auto"))
    assert found_px(helped, bright) > found_px(plain, bright) - 0.01  # tests/real: it helps
    other = replace(pair, left=exposed(pair.left, gain=1.4))
    assert balanced(Census(), "auto").balanced(other).right.max() < 200


def test_where_one_channel_is_clipped_the_others_still_tell():
    rng = np.random.default_rng(6)
    image = rng.integers(20, 200, (90, 120, 3), np.uint8)
    image[:30, :, 2] = 255
    assert clipped_share(image) == 0.0
    image[:30] = 255
    assert clipped_share(image) == pytest.approx(1 / 3, abs=0.01)
    tinted = np.rint(image * [0.7, 1.0, 1.0]).astype(np.uint8)  # clipped first, balanced then
    assert clipped_share(tinted) == pytest.approx(1 / 3, abs=0.01)
    image[:30, :, 0] = rng.integers(20, 200, (30, 120))
    assert clipped_share(image) < 0.01
    assert clipped_share(np.full((90, 120), 90, np.uint8)) == 0.0


def test_eyes_that_are_alike_stay_as_they_are(pair):
    matcher = balanced(Bm(), "auto", min_depth_m=1.0)
    assert isinstance(matcher, BalancedMatcher)
    assert matcher.balanced(pair) is pair
    assert balanced(Bm(), "always", min_depth_m=1.0).balanced(pair) is not pair


def test_never_is_never(pair):
    assert not isinstance(balanced(Sgbm(), "never"), BalancedMatcher)


def test_it_goes_to_other_processes(pair):
    matcher = balanced(Bm(), "auto", min_depth_m=1.0)
    bad = badly(pair, "gain 0.6")
    again = pickle.loads(pickle.dumps(matcher))(bad)
    np.testing.assert_array_equal(matcher(bad).values, again.values)


def test_grey_and_16_bit_pictures_are_balanced_too(pair):
    grey = pair.left[:, :, 1].astype(np.uint16) * 257
    both = replace(pair, left=grey, right=exposed(pair.right[:, :, 1].astype(np.uint16) * 257))
    dark = replace(both, right=exposed(both.right, gain=0.6))
    back = balanced(Sgbm(), "auto", min_depth_m=1.0).balanced(dark)
    assert back.right.dtype == np.uint16
    assert np.median(np.abs(back.right.astype(float) - both.right)) < 0.01 * 65535


def test_pairs_that_show_nothing_are_left_as_they_are(pair):
    flat = np.full_like(pair.right, 90)
    nothing = replace(pair, left=flat, right=flat // 2)
    assert balanced(Sgbm(), "always", min_depth_m=1.0).balanced(nothing) is nothing
    small = Synthetic("room", frames=1, width_px=64, height_px=32).open().load(0)
    balanced(Sgbm(disparities=16), "always").balanced(small)
