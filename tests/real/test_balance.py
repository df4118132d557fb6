"""Differently exposed eyes of real pairs: census does not care, SGBM is helped by a balance."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pseudolidar.evaluation.disparity import DisparityScore, disparity_errors
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.stereo.balance import balanced
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.sgbm import Sgbm
from tests.exposed import CASES, exposed
from tests.stereo.motorcycle import DISPARITIES, motorcycle

pytestmark = pytest.mark.real


@pytest.fixture(scope="module", params=["kitti", "motorcycle"])
def pairs(request, real_data):
    if request.param == "motorcycle":
        return [motorcycle(real_data)], DISPARITIES
    source = KittiStereo(str(real_data / "kitti_stereo2015" / "training")).open()
    return [source.load(index) for index in (0, 8, 16)], 128


def score(matcher, pairs, **difference):
    return DisparityScore(
        [
            disparity_errors(matcher(replace(p, right=exposed(p.right, **difference))), p.truth)
            for p in pairs
        ]
    )


def test_census_is_unharmed(pairs):
    frames, disparities = pairs
    matcher = balanced(Census(disparities=disparities), "auto")
    usual = score(matcher, frames)
    for name, difference in CASES.items():
        found = score(matcher, frames, **difference)
        assert found.d1_est < usual.d1_est + 0.005, name
        assert found.d1_filled < usual.d1_filled + 0.005, name


@pytest.mark.parametrize("name", ["gain 0.6", "gamma 0.6", "together"])
def test_sgbm_is_as_good_as_with_alike_eyes(pairs, name):
    frames, disparities = pairs
    settings = Sgbm(disparities=disparities)
    usual = score(balanced(settings, "never"), frames)
    without, with_balance = (
        score(balanced(settings, when), frames, **CASES[name]) for when in ("never", "auto")
    )
    assert without.d1_filled > usual.d1_filled + 0.008
    assert with_balance.d1_filled < usual.d1_filled + 0.003
    assert with_balance.density > usual.density - 0.01


def test_what_one_eye_is_too_bright_for_misleads_less(real_data):
    source = KittiStereo(str(real_data / "kitti_stereo2015" / "training")).open()
    frames = [source.load(index) for index in (0, 8, 16)]
    without, with_balance = (
        score(balanced(Census(), when), frames, gain=1.4) for when in ("never", "auto")
    )
    assert with_balance.density > without.density + 0.01
    assert with_balance.d1_filled < without.d1_filled


@pytest.mark.parametrize("name", ["red 1.4, blue 0.71", "red 0.71, blue 1.4"])
def test_a_colour_cast_does_not_take_texture_from_census(real_data, name):
    """A street so bright that 13 % of its pixels are clipped in every channel."""
    source = KittiStereo(str(real_data / "kitti_stereo2015" / "training")).open()
    frame = source.load(source.ids.index("000058_10"))
    cast = replace(frame, right=exposed(frame.right, **CASES[name]))
    assert balanced(Census(), "auto").balanced(cast) is cast
    without, with_balance = (
        score(balanced(Sgbm(), when), [frame], **CASES[name]) for when in ("never", "auto")
    )
    assert with_balance.d1_filled < without.d1_filled + 0.002
