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
    offset = DisparityCorrection(np.array([-0.625, 0, 0, 0, 0, 0, 0, 0, 0, 0.0]), 0.3)
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


def test_what_a_pitched_lidar_does_follows_from_the_slopes():
    """A ground of 0.05 px a row, with a hole beside which only one side is known."""
    ground = np.repeat(0.05 * np.arange(HEIGHT_PX, dtype=np.float32)[:, None] + 1, WIDTH_PX, axis=1)
    ground[16:18] = np.nan
    compared = against_scan(DisparityMap(ground), frame())
    y = (compared.v - 20) / 50
    rows_per_mrad = 50 * (1 + y * y) / 1000
    known = compared.matched
    assert known.mean() > 0.9
    np.testing.assert_allclose(compared.per_pitch[known], 0.05 * rows_per_mrad[known], rtol=1e-4)
    raised = compared.raised(0.002)
    more_px = raised.reference_px - compared.reference_px
    np.testing.assert_allclose(more_px[known], 2 * 0.05 * rows_per_mrad[known], rtol=1e-4)
    assert compared.raised(0.0) is compared
    np.testing.assert_array_equal(compared.samples().per_pitch, compared.per_pitch[known])


def test_edges_have_no_slope():
    step = wall().values.copy()
    step[20:] += 10
    compared = against_scan(DisparityMap(step), frame())
    np.testing.assert_array_equal(compared.per_pitch, 0.0)
