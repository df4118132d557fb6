"""The matchers' figures on the 22 frames of KITTI stereo 2015, raw, on the stock rig."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable
from typing import Any

import pytest

from pseudolidar.cli import main

FAR = 4  # the bin of 50 to 80 m


@pytest.fixture(scope="module")
def figures(real_data) -> Callable[[str], dict[str, Any]]:
    """What `evaluate disparity --json` prints for a matcher; each is run once."""
    known: dict[str, dict[str, Any]] = {}

    def of(matcher: str) -> dict[str, Any]:
        if matcher not in known:
            known[matcher] = evaluated(str(real_data / "kitti_stereo2015"), matcher)
        return known[matcher]

    return of


def evaluated(source: str, matcher: str) -> dict[str, Any]:
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        assert main(["evaluate", "disparity", source, "--matcher", matcher, "--json"]) == 0
    return json.loads(text.getvalue())


@pytest.mark.real
@pytest.mark.parametrize(
    ("matcher", "density", "d1_filled"), [("census", 0.88, 0.050), ("census:fine", 0.86, 0.052)]
)
def test_outliers_density_and_error(figures, matcher, density, d1_filled):
    found = figures(matcher)
    assert found["frames"] == 22
    assert found["d1_est"] <= 0.028
    assert found["density"] >= density
    assert found["d1_filled"] <= d1_filled
    assert found["epe"] <= 0.85


@pytest.mark.real
@pytest.mark.parametrize("matcher", ["census", "census:fine"])
def test_sigma_holds_on_frames_that_it_was_not_scaled_on(figures, matcher):
    found = figures(matcher)
    assert found["within_1_sigma"] == pytest.approx(0.68, abs=0.05)
    assert found["within_95"] == pytest.approx(0.95, abs=0.03)


@pytest.mark.real
@pytest.mark.parametrize(
    "other",
    [
        "census",
        *(
            pytest.param(f"sgbm:{mode}", marks=pytest.mark.slow)
            for mode in ("3way", "sgbm", "hh", "hh4")
        ),
    ],
)
def test_fine_is_best_at_50_to_80_m(figures, other):
    """With each matcher's own correction of the rig; without it the rig's bias covers all."""
    fine, others = figures("census:fine"), figures(other)
    assert fine["depth_refined"][FAR]["from_m"] == 50
    assert fine["depth_refined"][FAR]["median_rel"] < others["depth_refined"][FAR]["median_rel"]
    assert fine["depth_refined"][FAR]["median_rel"] < 0.5 * fine["depth"][FAR]["median_rel"]
