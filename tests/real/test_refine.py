"""The rig of KITTI stereo 2015, refined by Velodyne on every second frame, judged on the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.calibration.refine import refined
from pseudolidar.calibration.refine_fit import block_medians
from pseudolidar.evaluation.compared import against_scan
from pseudolidar.evaluation.ranges import errors_by_range
from pseudolidar.evaluation.sigma import sigma_shares, sigma_shares_by_range
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.stereo.census import Census
from pseudolidar.structures.samples import DisparitySamples

pytestmark = pytest.mark.real
# Largest median relative error and bias by range, from its nearest depth.
LIMITS = {5: (0.008, 0.005), 10: (0.012, 0.005), 20: (0.020, 0.005), 30: (0.032, 0.008)}
FARTHEST, FARTHEST_MEDIAN = 50, 0.043


@pytest.fixture(scope="module")
def compared(real_data):
    """Every frame, what is matched of it, and that beside its scan."""
    source = KittiStereo(str(real_data / "kitti_stereo2015" / "training")).open()
    match = Census(quality="fine").load()
    frames = [source.load(index) for index in range(len(source.ids))]
    return [(f, found, against_scan(found, f)) for f in frames for found in [match(f)]]


def by_refined(frame, matched, found):
    """A frame beside its scan by a refined rig, as sources that have it give it."""
    rig = frame.rig.with_correction(found.correction).with_lidar_raised(found.lidar_pitch_rad)
    return against_scan(matched, replace(frame, rig=rig))


def refined_by(compared):
    return refined(DisparitySamples.concatenate([each.samples() for _, _, each in compared]))


@pytest.fixture(scope="module", params=["even", "odd"])
def judged(request, compared):
    """Frames outside the fit, on the rig refined by the others."""
    fitted, others = compared[0::2], compared[1::2]
    if request.param == "odd":
        fitted, others = others, fitted
    found = refined_by(fitted)
    assert found.lidar_pitch_rad > 0
    return [by_refined(frame, matched, found) for frame, matched, _ in others]


def pooled(frames, column):
    return np.concatenate([getattr(frame, column) for frame in frames])


def test_depths_hold_on_frames_outside_the_fit(judged):
    bins = errors_by_range(pooled(judged, "depth_m"), pooled(judged, "reference_m"))
    by_range = {b.from_m: b for b in bins}
    for from_m, (median, bias) in LIMITS.items():
        assert by_range[from_m].median_rel <= median
        assert abs(by_range[from_m].bias_rel) <= bias
    assert by_range[FARTHEST].median_rel <= FARTHEST_MEDIAN


def test_sigma_stays_calibrated(judged):
    error = pooled(judged, "corrected_px") - pooled(judged, "reference_px")
    known = np.isfinite(error)
    sigma = pooled(judged, "total_sigma_px")[known]
    whole = sigma_shares(error[known], sigma)
    assert whole.within_1_sigma == pytest.approx(0.68, abs=0.05)
    assert whole.within_95 == pytest.approx(0.95, abs=0.03)
    for each in sigma_shares_by_range(error[known], sigma, pooled(judged, "reference_m")[known]):
        assert each["within_1_sigma"] == pytest.approx(0.68, abs=0.10)
        assert each["within_95"] == pytest.approx(0.95, abs=0.10)


def test_the_correction_belongs_to_the_rig(compared, real_data):
    """What single frames of many drives tell mends a drive that is not among them."""
    found = refined_by(compared)
    source, match = KittiRaw(str(real_data / "kitti_raw")).open(), Census(quality="fine").load()
    pairs = [(frame, match(frame)) for frame in (source.load(index) for index in (0, 9))]
    stock = [against_scan(matched, frame) for frame, matched in pairs]
    mended = [by_refined(frame, matched, found) for frame, matched in pairs]
    before, after = (
        errors_by_range(pooled(each, "depth_m"), pooled(each, "reference_m"))
        for each in (stock, mended)
    )
    for one, other in zip(before, after, strict=True):
        assert other.median_rel < one.median_rel
    assert after[-1].median_rel < 0.7 * before[-1].median_rel


def test_what_a_correction_leaves_is_what_it_says(judged):
    """68 % of the medians of image blocks, outside the fit."""
    correction = judged[0].rig.correction
    samples = DisparitySamples.concatenate([frame.samples() for frame in judged])
    left = np.abs(list(block_medians(samples, np.append(correction.coefficients, 0.0))))
    assert np.quantile(left, 0.68) == pytest.approx(correction.residual_px, rel=0.25)
