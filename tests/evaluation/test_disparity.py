import cv2
import numpy as np
import pytest

from pseudolidar.errors import ReferenceMissing, StructureError
from pseudolidar.evaluation.disparity import DisparityScore, disparity_errors
from pseudolidar.geometry.gaps import filled
from pseudolidar.structures.disparity import DisparityMap

NAN = np.nan


def row(*values) -> np.ndarray:
    return np.array([values], np.float32)


def read_disparity_png(path) -> DisparityMap:
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32) / 256
    return DisparityMap(np.where(raw > 0, raw, np.float32(NAN)))


def test_the_known_answer_of_the_devkit(real_data):
    folder = real_data / "devkit_disparity"
    errors = disparity_errors(
        read_disparity_png(folder / "disp_est.png"), read_disparity_png(folder / "disp_gt.png")
    )
    assert errors.bad_share(3.0) == pytest.approx(0.04393, abs=5e-6)
    assert errors.d1_est == pytest.approx(0.04392, abs=5e-6)
    assert errors.epe == pytest.approx(0.697, abs=5e-4)


def test_an_outlier_is_off_by_more_than_three_pixels_and_five_percent():
    truth = row(10.0, 10.0, 100.0, 100.0, 10.0)
    estimate = row(13.0, 13.1, 104.9, 105.1, NAN)
    errors = disparity_errors(DisparityMap(estimate), DisparityMap(truth))
    assert errors.outliers == 2
    assert errors.d1_est == 0.5
    assert errors.density == 0.8
    assert errors.bad == (4, 4, 3)
    assert errors.epe == pytest.approx((3.0 + 3.1 + 4.9 + 5.1) / 4, rel=1e-6)


def test_gaps_take_the_smaller_neighbour_and_borders_the_only_one():
    np.testing.assert_array_equal(
        filled(row(NAN, 5.0, NAN, NAN, 3.0, NAN, 9.0, NAN)), row(5, 5, 3, 3, 3, 3, 9, 9)
    )


def test_empty_rows_copy_the_row_above_and_the_first_ones_below():
    empty, first, second = row(NAN, NAN), row(4.0, NAN), row(NAN, 6.0)
    values = np.concatenate([empty, first, empty, second, empty])
    np.testing.assert_array_equal(filled(values), [[4, 4], [4, 4], [4, 4], [6, 6], [6, 6]])


def devkit_interpolation(values: np.ndarray) -> np.ndarray:
    """The devkit's loops, as in its `interpolateBackground`."""
    out, (height, width) = values.copy(), values.shape
    for v in range(height):
        count = 0
        for u in range(width):
            if np.isfinite(out[v, u]):
                if count:
                    first, last = u - count, u - 1
                    if first > 0 and last < width - 1:
                        out[v, first : last + 1] = min(out[v, first - 1], out[v, last + 1])
                count = 0
            else:
                count += 1
        known = np.flatnonzero(np.isfinite(out[v]))
        if len(known):
            out[v, : known[0]], out[v, known[-1] :] = out[v, known[0]], out[v, known[-1]]
    for u in range(width):
        known = np.flatnonzero(np.isfinite(out[:, u]))
        if len(known):
            out[: known[0], u], out[known[-1] :, u] = out[known[0], u], out[known[-1], u]
    return out


def test_same_filling_as_the_devkit():
    rng = np.random.default_rng(8)
    values = rng.uniform(1, 90, (40, 60)).astype(np.float32)
    values[rng.random(values.shape) < 0.6] = NAN
    values[:3] = NAN
    values[-2:] = NAN
    np.testing.assert_array_equal(filled(values), devkit_interpolation(values))


def test_an_empty_estimate_is_all_wrong_and_not_an_error():
    errors = disparity_errors(DisparityMap(row(NAN, NAN)), DisparityMap(row(5.0, 6.0)))
    assert (errors.density, errors.d1_est, errors.epe, errors.d1_filled) == (0.0, None, None, 1.0)
    assert np.isnan(filled(row(NAN, NAN))).all()


def test_score_is_the_mean_over_frames_and_pooled_counts_pixels():
    truth = DisparityMap(row(10.0, 10.0, 10.0, 10.0))
    one = disparity_errors(DisparityMap(row(20.0, NAN, NAN, NAN)), truth)
    other = disparity_errors(DisparityMap(row(10.0, 10.0, 10.0, 11.0)), truth)
    score = DisparityScore([one, other])
    assert score.d1_est == 0.5
    assert score.pooled.d1_est == 0.2
    assert score.density == 0.625
    assert score.epe == pytest.approx((10 + 0.25) / 2)
    assert score.pooled.epe == pytest.approx(11 / 5)
    assert score.d1_filled == 0.5
    assert score.bad_share(3.0) == 0.5


def test_maps_of_other_size_and_empty_truth_are_refused():
    with pytest.raises(StructureError):
        disparity_errors(DisparityMap(row(1.0)), DisparityMap(row(1.0, 2.0)))
    with pytest.raises(ReferenceMissing):
        disparity_errors(DisparityMap(row(1.0)), DisparityMap(row(NAN)))


@pytest.mark.real
def test_opencv_rows_of_the_published_table(real_data):
    """SGBM 3-way, block 5, checks on: 3.86 % D1, 87.3 % density, EPE 0.98, 8.09 % filled."""
    matcher = cv2.StereoSGBM.create(
        numDisparities=128,
        blockSize=5,
        P1=200,
        P2=800,
        disp12MaxDiff=1,
        preFilterCap=63,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    folder = real_data / "kitti_stereo2015" / "training"
    frames = []
    for path in sorted((folder / "image_2").glob("*.png")):
        left, right = (
            cv2.imread(str(folder / name / path.name), cv2.IMREAD_GRAYSCALE)
            for name in ("image_2", "image_3")
        )
        values = matcher.compute(left, right).astype(np.float32) / 16
        estimate = DisparityMap(np.where(values > 0, values, np.float32(NAN)))
        frames.append(
            disparity_errors(estimate, read_disparity_png(folder / "disp_occ_0" / path.name))
        )
    score = DisparityScore(frames)
    assert len(frames) == 22
    assert score.d1_est == pytest.approx(0.0386, abs=1e-4)
    assert score.density == pytest.approx(0.873, abs=1e-3)
    assert score.epe == pytest.approx(0.98, abs=5e-3)
    assert score.d1_filled == pytest.approx(0.0809, abs=1e-4)
