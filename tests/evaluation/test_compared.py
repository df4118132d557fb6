from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.compared import against_scan, against_truth
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from tests.evaluation.test_lidar import HEIGHT_PX, WIDTH_PX, frame, wall


def test_points_without_a_match_stay_and_count():
    compared = against_scan(wall(slice(0, 30)), frame())
    assert len(compared) == WIDTH_PX * HEIGHT_PX // 4
    assert compared.matched.mean() == 0.5
    np.testing.assert_allclose(compared.depth_m[compared.matched], 10.0, rtol=1e-6)
    assert np.isnan(compared.depth_m[~compared.matched]).all()
    np.testing.assert_allclose(compared.reference_m, 8.0, rtol=1e-6)
    np.testing.assert_allclose(compared.reference_px, 50.0 * 0.5 / 8.0, rtol=1e-6)
    assert compared.total_sigma_px is None


def test_the_correction_of_the_rig_is_taken_off_once():
    bare = frame()
    offset = DisparityCorrection(np.array([-0.625, 0, 0, 0, 0, 0, 0, 0.0]), 0.3)
    pair = replace(bare, rig=bare.rig.with_correction(offset))
    matched = DisparityMap(wall().values, np.full((HEIGHT_PX, WIDTH_PX), 0.4, np.float32))
    compared = against_scan(matched, pair)
    np.testing.assert_allclose(compared.disparity_px, 2.5)
    np.testing.assert_allclose(compared.depth_m, 8.0, rtol=1e-6)
    np.testing.assert_allclose(compared.total_sigma_px, 0.5)
    samples = compared.samples(7)
    np.testing.assert_allclose(samples.measured, 2.5)  # fits look at what was measured
    assert set(samples.frame) == {7}


def test_truth_is_compared_where_it_is_known():
    pair = replace(frame(), truth=wall(slice(10, 40)))
    everything = against_truth(wall(), pair)
    assert (len(everything), int(everything.matched.sum())) == (30 * HEIGHT_PX, 30 * HEIGHT_PX)
    np.testing.assert_allclose(everything.depth_m, everything.reference_m)
    assert 90 <= len(against_truth(wall(), pair, most=100)) <= 100


def test_a_frame_without_reference_is_refused():
    with pytest.raises(ReferenceMissing, match="frame 0 has no LiDAR scan"):
        against_scan(wall(), frame(scan=False))
    with pytest.raises(ReferenceMissing, match="frame 0 has no ground-truth"):
        against_truth(wall(), frame())
