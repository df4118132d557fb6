from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.calibration.refine import fit
from pseudolidar.evaluation.halves import FrameSamples, judge_halves, residuals
from pseudolidar.geometry.triangulation import depth_from_disparity, disparity_from_depth
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.samples import DisparitySamples

SIZE_PX = (1242, 375)
OFFSET_PX = 0.6
STATED_TOO_LARGE = 2.0


def rig() -> StereoRig:
    K = np.array([[721.5, 0, 609.6], [0, 721.5, 172.9], [0, 0, 1.0]])
    baseline = np.array([-0.53, 0.0, 0.0])
    return StereoRig(
        Camera(K, *SIZE_PX),
        Camera(K, *SIZE_PX, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3), baseline),
    )


def frames(count: int, *, each=5000, with_sigma=True) -> list[FrameSamples]:
    """Frames whose disparities are 0.6 px too large and whose sigma is twice too large."""
    rng = np.random.default_rng(11)
    made = []
    for number in range(count):
        u, v = rng.uniform(0, SIZE_PX[0] - 1, each), rng.uniform(0, SIZE_PX[1] - 1, each)
        reference = disparity_from_depth(rng.uniform(5, 80, each), u, rig())
        sigma = rng.uniform(0.2, 1.0, each)
        measured = reference + OFFSET_PX + rng.normal(0, sigma)
        samples = DisparitySamples(
            measured,
            reference,
            u,
            v,
            np.full(each, number),
            SIZE_PX,
            STATED_TOO_LARGE * sigma if with_sigma else None,
        )
        made.append(FrameSamples(samples, rig()))
    return made


def test_fitted_on_one_half_right_on_the_other():
    judged = judge_halves(frames(6), fit=fit)
    assert judged is not None
    assert abs(np.median(judged.residuals.error_px)) < 0.02
    shares = judged.residuals.sigma_shares()
    assert shares.n == 6 * 5000
    assert shares.within_1_sigma == pytest.approx(0.6827, abs=0.02)
    assert judged.scales == pytest.approx((1 / STATED_TOO_LARGE,) * 2, rel=0.05)
    assert all(residual < 0.1 for residual in judged.residual_px)
    for stock, refined in zip(
        residuals(frames(6), correction=None).by_range(), judged.residuals.by_range(), strict=True
    ):
        assert stock.n == refined.n > 0
        assert abs(refined.bias_rel) < 0.3 * abs(stock.bias_rel)


def test_no_frame_is_judged_with_a_fit_to_itself():
    fitted_to: list[set[int]] = []

    def remembering(samples: DisparitySamples) -> DisparityCorrection:
        fitted_to.append(set(samples.frame))
        return DisparityCorrection(np.array([float(min(samples.frame))] + [0.0] * 9), 0.1)

    judged = judge_halves([odd_ones_off_by(10.0, f) for f in frames(4, each=1000)], fit=remembering)
    assert fitted_to == [{0, 2}, {1, 3}]
    # Odd frames are judged with the fit to even ones, which takes off 0 px; even ones lose 1 px.
    odd, even = np.split(judged.residuals.error_px, 2)
    assert np.median(odd) == pytest.approx(OFFSET_PX + 10.0, abs=0.1)
    assert np.median(even) == pytest.approx(OFFSET_PX - 1.0, abs=0.1)


def odd_ones_off_by(offset_px: float, frame: FrameSamples) -> FrameSamples:
    samples = frame.samples
    measured = samples.measured + offset_px * (samples.frame % 2)
    return FrameSamples(replace(samples, measured=measured), frame.rig)


def test_raw_errors_are_judged_with_the_error_of_an_unrefined_rig():
    raw = residuals(frames(2), correction=None)
    np.testing.assert_allclose(raw.total_px, np.hypot(raw.sigma_px, 0.5))
    assert np.median(raw.error_px) == pytest.approx(OFFSET_PX, abs=0.05)


def test_depths_are_those_of_the_rig():
    (frame,) = frames(1, each=100)
    judged = residuals([frame], correction=None)
    samples = frame.samples
    np.testing.assert_allclose(
        judged.depth_m, depth_from_disparity(samples.measured, samples.u, frame.rig)
    )


def test_a_single_frame_cannot_be_judged_in_halves():
    assert judge_halves(frames(1), fit=fit) is None


def test_a_matcher_without_sigma_still_has_its_depth_judged():
    judged = judge_halves(frames(2, with_sigma=False), fit=fit)
    assert judged.residuals.sigma_shares() is None
    assert judged.residuals.sparsification_error() is None
    assert judged.residuals.sigma_by_range() == ()
    assert judged.scales == ()
    assert sum(row.n for row in judged.residuals.by_range()) > 9000


def test_images_of_several_sizes_share_one_correction():
    large, small = frames(2, each=100)
    half = replace(small.samples, size_px=(621, 188), u=small.samples.u / 2, v=small.samples.v / 2)
    together = DisparitySamples.concatenate([large.samples, half])
    assert together.size_px == SIZE_PX
    np.testing.assert_allclose(together.u[100:] / 1241, half.u / 620)
    np.testing.assert_allclose(together.v[100:] / 374, half.v / 187)
