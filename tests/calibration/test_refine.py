from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.calibration.refine import ONE_FRAME_RESIDUAL_PX, fit, refined
from pseudolidar.calibration.refine_fit import some_of
from pseudolidar.errors import CalibrationValue
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.samples import DisparitySamples

SIZE_PX = (1242, 375)
PLANTED = np.array([-0.5, 0.7, 0.1, 0.4, -1.1, 0.6, -0.4, -0.6, 0.2, -0.3])
NOISE_PX = 0.5


def samples(
    *, frames=8, each=4000, drift_px=0.0, outliers=0.1, seed=7, noise_px=NOISE_PX
) -> DisparitySamples:
    """Frames of a rig with a planted error; reference disparities grow downwards, as on a road."""
    rng = np.random.default_rng(seed)
    n = frames * each
    u, v = rng.uniform(0, SIZE_PX[0] - 1, n), rng.uniform(150, SIZE_PX[1] - 1, n)
    reference = 3.0 + 60.0 * ((v - 150) / 225) ** 2 + rng.uniform(0, 20, n)
    frame = np.repeat(np.arange(frames), each)
    offset = DisparityCorrection.features(reference, u, v, SIZE_PX) @ PLANTED
    # The correction is a function of the measured disparity: a second pass is exact to 1e-3 px.
    offset = DisparityCorrection.features(reference + offset, u, v, SIZE_PX) @ PLANTED
    noise = noise_px * rng.normal(0, 1, n) + drift_px * rng.normal(0, 1, frames)[frame]
    wrong = rng.random(n) < outliers
    noise[wrong] += rng.uniform(2, 40, wrong.sum())
    return DisparitySamples(reference + offset + noise, reference, u, v, frame, SIZE_PX)


def offset_errors_px(correction: DisparityCorrection, at: DisparitySamples) -> np.ndarray:
    found, planted = (
        each.offset_px(at.measured, at.u, at.v, SIZE_PX)
        for each in (correction, DisparityCorrection(PLANTED, 0.0))
    )
    return np.abs(found - planted)


def test_a_planted_error_is_found_among_outliers():
    correct = samples(outliers=0.0)
    correction = fit(samples(), origin="planted")
    assert correction.origin == "planted"
    # 10 % of outliers, all to one side and larger than the noise, shift a Cauchy fit by 0.1 px.
    assert np.quantile(offset_errors_px(correction, correct), 0.95) < 0.2


def test_outliers_would_spoil_plain_least_squares():
    data, correct = samples(), samples(outliers=0.0)
    features = DisparityCorrection.features(data.measured, data.u, data.v, SIZE_PX)
    plain, *_ = np.linalg.lstsq(features, data.measured - data.reference, rcond=None)
    errors_px = offset_errors_px(DisparityCorrection(plain, 0.0), correct)
    assert np.quantile(errors_px, 0.95) > 1.0


@pytest.mark.parametrize("drift_px", [0.0, 0.2, 0.5])
def test_the_residual_is_the_drift_between_frames_and_not_pixel_noise(drift_px):
    correction = fit(samples(frames=24, drift_px=drift_px, outliers=0.05))
    # 24 frames tell a standard deviation to about 15 %; blocks of 250 samples and the fold's own
    # fit add some hundredths.
    assert correction.residual_px == pytest.approx(np.hypot(drift_px, 0.05), rel=0.35)


def test_the_residual_is_that_of_frames_outside_the_fit():
    """Two frames that differ by 2 px: the mean of both is 1 px off each, a fit to one 2 px."""
    data = samples(frames=2, outliers=0.0)
    differing = replace(data, measured=data.measured + 2.0 * data.frame)
    assert fit(differing).residual_px > 2.0


def test_one_frame_does_not_claim_to_know_how_frames_differ():
    assert fit(samples(frames=1)).residual_px >= ONE_FRAME_RESIDUAL_PX


def test_few_samples_of_a_corner_do_not_blow_up_elsewhere():
    data = samples(frames=1, each=60_000)
    corner = data[(data.u < 250) & (data.measured < 25)]
    correction = fit(corner)
    grid = samples(frames=1, outliers=0.0)
    offset = correction.offset_px(grid.measured, grid.u, grid.v, SIZE_PX)
    assert len(corner) >= 500
    assert np.abs(offset).max() < 5.0


def test_perfect_data_need_no_correction():
    data = samples(outliers=0.0)
    correction = fit(replace(data, measured=data.reference))
    np.testing.assert_allclose(correction.coefficients, 0.0, atol=1e-9)
    assert correction.residual_px == 0.0


def test_pixels_without_a_disparity_do_not_count():
    data = samples()
    measured = data.measured.copy()
    measured[::2] = np.nan
    np.testing.assert_allclose(
        fit(replace(data, measured=measured)).coefficients, fit(data[1::2]).coefficients
    )


@pytest.mark.slow
def test_unsure_samples_say_less():
    """Half of the samples are off by 2 px, and their sigma tells that they may be."""
    data, unsure = samples(outliers=0.0), np.arange(32_000) % 2 == 0
    biased = replace(data, measured=data.measured + 2.0 * unsure)
    told = replace(biased, sigma=np.where(unsure, 5.0, NOISE_PX))
    errors_px = [np.median(offset_errors_px(fit(each), data)) for each in (biased, told)]
    assert errors_px[1] < 0.2 < 0.5 < errors_px[0]


@pytest.mark.parametrize("sigma_px", [0.0, np.nan, np.inf])
def test_samples_without_a_real_sigma_do_not_count(sigma_px):
    data = replace(samples(), sigma=np.full(32_000, NOISE_PX))
    known = np.arange(32_000) % 2 == 1
    given = replace(data, sigma=np.where(known, data.sigma, sigma_px))
    np.testing.assert_allclose(fit(given).coefficients, fit(data[known]).coefficients)


def test_too_little_data_is_refused():
    with pytest.raises(CalibrationValue, match="samples"):
        fit(samples(frames=1, each=400))


@pytest.mark.slow
def test_two_fits_differ_by_what_their_covariances_say():
    """Frames drift by 0.2 px, so that fits to eight frames and to eight others differ."""
    ratios = []
    for seed in range(4):
        pair = [fit(samples(drift_px=0.2, each=1500, seed=2 * seed + i)) for i in range(2)]
        at = samples(frames=1, each=500, outliers=0.0)
        offsets = [c.offset_px(at.measured, at.u, at.v, SIZE_PX) for c in pair]
        sigmas = [c.offset_sigma_px(at.measured, at.u, at.v, SIZE_PX) for c in pair]
        ratios.append((offsets[0] - offsets[1]) / np.hypot(*sigmas))
    # four pairs of fits tell a standard deviation to some 35 %
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.6


@pytest.mark.parametrize(("each", "least_px"), [(60, 0.1), (1000, 0.25)])
def test_a_sparse_reference_is_no_perfect_rig(each, least_px):
    """Points of a LiDAR with few beams: no block of a frame has many, and errors are seen still."""
    data = samples(frames=20, each=each, drift_px=0.3, outliers=0.0)
    found = refined(data)
    assert found.choice.chosen.name != "none"
    assert found.choice.candidates[0].left_px > 0.3
    # frames drift by 0.3 px: 1000 points of each show it, of 60 only a part
    assert least_px < found.correction.residual_px < 0.45


def test_the_covariance_leaves_no_direction_out():
    """Of the terms that were chosen; the others are 0, and surely so."""
    correction = fit(samples(frames=4))
    chosen = correction.coefficients != 0
    assert chosen.sum() >= 8
    assert np.linalg.eigvalsh(correction.covariance[np.ix_(chosen, chosen)]).min() > 0


def test_every_second_sample_is_no_fair_share():
    """What alternates from sample to sample does so in the share that is fitted."""
    data = samples(frames=8, each=6000, outliers=0.0)
    part = some_of(data, 10_000)
    index = np.flatnonzero(np.isin(data.u, part.u))
    assert len(part) == 10_000
    assert np.mean(index % 2) == pytest.approx(0.5, abs=0.03)
    assert np.array_equal(some_of(data, 10_000).u, part.u)
    assert some_of(data, len(data)) is data


def test_sigma_is_scaled_by_the_disparity_as_the_errors_ask():
    """Near surfaces are twice as sure as the matcher says, far ones half as sure."""
    data = samples(each=8000, outliers=0.0)
    noise = data.measured - samples(each=8000, outliers=0.0, noise_px=0.0).measured
    far = data.reference < 16
    data = replace(
        data,
        measured=data.measured + np.where(far, 1.0, -0.5) * noise,
        sigma=np.full(len(data), NOISE_PX),
    )
    scale = fit(data).sigma_scale
    assert scale.at(np.array([10.0])) == pytest.approx(2.0, rel=0.1)
    assert scale.at(np.array([60.0])) == pytest.approx(0.5, rel=0.1)
    assert (np.diff(scale.disparities_px) > 0).all()


def test_a_sigma_that_is_known_to_be_right_stays():
    data = samples(outliers=0.0)
    scale = fit(replace(data, sigma=np.full(len(data), NOISE_PX))).sigma_scale
    np.testing.assert_allclose(scale.factors, 1.0, rtol=0.1)


def test_noise_of_disparities_does_not_bend_the_far_range():
    """The disparity is a feature and noisy: where it is small, that could pull the fit (dilution).

    A rig with an offset and a scale, and noise of a tenth of the smallest disparities: the median
    that is left in each octave of the true disparity stays below 0.03 px.
    """
    rng = np.random.default_rng(3)
    data = samples(each=8000, outliers=0.0)
    reference = 3.0 * 2 ** rng.uniform(0, 4.5, len(data))
    measured = (reference - 0.5) / (1 - 0.7 / 50) + rng.normal(0, 0.4, len(data))
    data = replace(data, reference=reference, measured=measured)
    found = refined(data)
    assert "scale" in found.choice.chosen.name
    offset = found.correction.offset_px(data.measured, data.u, data.v, SIZE_PX)
    octave = np.log2(reference / 3.0).astype(int)
    for number in range(5):
        assert abs(np.median((measured - offset - reference)[octave == number])) < 0.03


PITCH_MRAD = 0.8


def with_pitch(data: DisparitySamples, *, upright: float = 0.4, seed=3) -> DisparitySamples:
    """The same against a LiDAR that looks too low; a share of the samples stands upright."""
    per_pitch = np.where(np.random.default_rng(seed).random(len(data)) < upright, 0.0, 0.23)
    reference = data.reference - PITCH_MRAD * per_pitch
    return replace(data, reference=reference, per_pitch=per_pitch)


def test_a_lidar_that_looks_too_low_is_found_and_spoils_nothing():
    clean = samples(outliers=0.05, noise_px=0.2)
    data = with_pitch(clean)
    found = refined(data)
    assert "pitch of the LiDAR" in found.choice.chosen.name
    off_mrad = 1000 * found.lidar_pitch_rad - PITCH_MRAD
    assert abs(off_mrad) < min(0.1, 3000 * found.lidar_pitch_sigma_rad)
    unaware = fit(replace(data, per_pitch=None))
    assert np.quantile(offset_errors_px(unaware, clean), 0.5) > 0.1
    assert np.quantile(offset_errors_px(found.correction, clean), 0.5) < 0.04


def test_a_lidar_that_is_right_is_left_alone():
    data = replace(samples(), per_pitch=with_pitch(samples()).per_pitch)
    found = refined(data)
    assert found.lidar_pitch_rad == 0 == found.lidar_pitch_sigma_rad
    assert "pitch" not in found.choice.chosen.name


@pytest.mark.parametrize("upright", [0.0, 1.0])
def test_ground_alone_or_walls_alone_tell_no_pitch(upright):
    assert refined(with_pitch(samples(), upright=upright)).lidar_pitch_rad == 0


def test_ground_and_walls_that_disagree_are_part_of_what_is_left():
    """One frame cannot tell the pitch: what that does to surfaces is in the systematic error."""
    data = samples(frames=1, each=20_000, outliers=0.0, noise_px=0.1)
    ground = np.random.default_rng(0).random(len(data)) < 0.6
    data = replace(data, measured=data.measured + ground)
    told = refined(replace(data, per_pitch=np.where(ground, 0.23, 0.0)))
    assert told.lidar_pitch_rad == 0
    assert told.correction.residual_px > 1.5 * fit(data).residual_px
