"""Filters of dense maps on real pairs: they must not lose what the matcher has found."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.disparity import disparity_errors
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.map_filter import MapFilters
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.sgbm import Sgbm
from tests.stereo.motorcycle import DISPARITIES, motorcycle

pytestmark = pytest.mark.real
FILTERS = {
    "matched": MapFilters(),
    "smooth": MapFilters.load(Fgs()),
    "dense": MapFilters.load(Fgs(dense=True)),
    "fill": MapFilters.load(Surfaces()),
    "both": MapFilters.load(Fgs(), Surfaces()),
}


def scores(pairs, matcher):
    """Means by filter: D1 of pixels with a disparity, density, EPE, D1 with gaps filled."""
    found = {name: [] for name in FILTERS}
    for pair in pairs:
        matched = matcher(pair)
        for name, filters in FILTERS.items():
            e = disparity_errors(filters(pair, matched).disparity, pair.truth)
            found[name].append((e.d1_est, e.density, e.epe, e.d1_filled))
    return {name: np.mean(rows, axis=0) for name, rows in found.items()}


@pytest.fixture(scope="module")
def kitti(real_data):
    source = KittiStereo(str(real_data / "kitti_stereo2015" / "training")).open()
    return scores([source.load(index) for index in range(0, 22, 2)], Census().load())


@pytest.fixture(scope="module")
def middlebury(real_data):
    return scores([motorcycle(real_data)], Census(disparities=DISPARITIES).load())


@pytest.mark.parametrize("data", ["kitti", "middlebury"])
@pytest.mark.slow
def test_smoothing_gains_on_pixels_with_a_match_and_with_gaps_filled(data, request):
    found = request.getfixturevalue(data)
    (d1, density, epe, filled), smooth = found["matched"], found["smooth"]
    assert smooth[0] < (0.95 if data == "kitti" else 0.99) * d1
    assert smooth[1] == density
    assert smooth[2] < epe
    assert smooth[3] < 0.97 * filled


@pytest.mark.parametrize("data", ["kitti", "middlebury"])
def test_a_dense_map_is_no_worse_than_filling_by_the_rows_minimum(data, request):
    found = request.getfixturevalue(data)
    assert found["dense"][1] == pytest.approx(1, abs=1e-3)
    assert found["dense"][3] <= found["matched"][3]
    assert found["dense"][0] <= found["matched"][3]


def test_a_dense_map_of_another_matcher_loses_nothing_either(real_data):
    """Middlebury, SGBM: 96 columns without a match, no sigma; 9.57 % by the row's minimum."""
    pair = motorcycle(real_data)
    found = scores([pair], Sgbm(disparities=DISPARITIES).load())
    assert found["dense"][3] <= found["matched"][3]
    assert found["smooth"][3] <= found["matched"][3]


def test_filled_holes_are_as_good_as_the_rows_minimum_on_kitti(kitti):
    assert kitti["fill"][1] > kitti["matched"][1] + 0.01
    assert kitti["fill"][3] <= kitti["matched"][3]
    assert kitti["both"][3] < kitti["matched"][3]
