"""How near matches are against what is searched: the numbers, and what is to be passed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import CalibrationValue
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.nearness import (
    BEYOND_SHARE,
    LEAST_MATCHES,
    NEAREST,
    Searching,
    nearest_found,
)
from pseudolidar.running.preflight import check_source
from pseudolidar.sources.other_rig import with_rig
from pseudolidar.sources.source import nearest_depth_m
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.disparity_range import disparity_range
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.disparity import TYPED, typed_below
from pseudolidar.structures.quality import CalibrationQuality


@pytest.fixture(scope="module")
def street():
    return Synthetic("street", frames=1).open()


@pytest.fixture(scope="module")
def pair(street):
    check = check_source(street, crew=CrewPlan(1), searching=Searching(Census()))
    (near,) = (finding for finding in check.findings if finding.name == NEAREST)
    assert near.severity == "good"
    return check.pairs[0]


@pytest.mark.parametrize("matcher", [Census(), Sgbm(), Bm()])
def test_what_is_passed_holds_what_is_seen(street, pair, matcher):
    """Of the street a tenth is nearer than 12 m."""
    found = nearest_found([pair], street, Searching(matcher, 12.0))
    assert found.severity == "warn"
    wanted_m = float(found.mend.removeprefix("Pass --min-depth ").removesuffix("."))
    assert disparity_range(street.rig, wanted_m) >= np.quantile(pair.depths_px, 0.98)
    again = nearest_found([pair], street, Searching(matcher, wanted_m))
    assert again.severity == "good"
    assert 0.02 < found.figures["nearer"] < 0.3


def with_depths(pair, street, depths_m):
    return replace(pair, depths_px=street.rig.fB_px_m / np.asarray(depths_m, float))


def test_a_few_wrong_matches_are_no_things(street, pair):
    depths_m = np.full(1000, 20.0)
    depths_m[: round(1000 * BEYOND_SHARE) - 1] = 0.5
    few = [with_depths(pair, street, depths_m)]
    assert nearest_found(few, street, Searching(Census())).severity == "good"
    depths_m[: round(1000 * BEYOND_SHARE)] = 0.5
    enough = [with_depths(pair, street, depths_m)]
    assert nearest_found(enough, street, Searching(Census())).severity == "warn"


def test_too_few_matches_tell_nothing(street, pair):
    few = [with_depths(pair, street, np.full(LEAST_MATCHES - 1, 0.5))]
    assert nearest_found(few, street, Searching(Census())).severity == "unknown"


def test_where_half_the_width_is_searched_no_flag_helps(street, pair):
    found = nearest_found(
        [with_depths(pair, street, np.full(100, 0.3))], street, Searching(Census(), 0.1)
    )
    assert found.severity == "warn"
    assert "half the width" in found.mend
    assert "--min-depth" not in found.mend


def test_networks_and_rigs_without_metres_are_not_judged(street, pair):
    assert nearest_found([pair], street, Searching(Onnx(Path("net.onnx")))) is None
    free = with_rig(street, replace(street.rig, metric=False))
    assert nearest_found([pair], free, Searching(Census(), 12.0)) is None


@pytest.mark.parametrize(
    ("depth_m", "typed_m"),
    [(3.0, 3.0), (2.9999999999999996, 3.0), (0.131, 0.12), (0.99, 0.8), (17.0, 15.0), (0.1, 0.1)],
)
def test_depths_that_a_person_would_type(depth_m, typed_m):
    assert typed_below(depth_m) == typed_m


def test_every_depth_has_one_below():
    for depth_m in np.geomspace(1e-3, 1e3, 997):
        typed_m = typed_below(depth_m)
        assert typed_m <= depth_m * (1 + 1e-9)
        assert typed_m > depth_m / max(b / a for a, b in zip(TYPED, [*TYPED[1:], 10], strict=True))


def test_a_board_says_how_near_a_rig_is_used():
    assert CalibrationQuality().searched_from_m is None
    assert CalibrationQuality(nearest_m=0.2).searched_from_m == 0.15
    with pytest.raises(CalibrationValue, match="nearest_m"):
        CalibrationQuality(nearest_m=0.0)


def test_flags_count_more_than_boards(street):
    near = with_rig(street, replace(street.rig, quality=CalibrationQuality(nearest_m=0.5)))
    assert nearest_depth_m(None, street) == 3.0
    assert nearest_depth_m(None, near) == 0.4
    assert nearest_depth_m(1.0, near) == 1.0
