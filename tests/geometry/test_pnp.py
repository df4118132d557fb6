import numpy as np
import pytest

from pseudolidar.geometry.pnp import (
    MIN_POINTS,
    first_pose,
    linearised,
    normal_equations,
    refined_pose,
)
from pseudolidar.geometry.twists import exp_twist
from tests.moving_rig import STEP, rig, tracks

T = exp_twist(STEP)


@pytest.mark.parametrize("doffs_px", [0.0, 12.0])
@pytest.mark.parametrize("fy_px", [700.0, 650.0])
def test_perfect_tracks_give_the_pose(doffs_px, fy_px):
    of = rig(doffs_px=doffs_px, fy_px=fy_px)
    seen = tracks(of, T)
    found = refined_pose(first_pose(seen, of), seen, of)
    assert np.allclose(found.T_to_from, T, atol=1e-6)
    assert np.all(found.weights > 0.99)
    assert found.distance_m == pytest.approx(np.linalg.norm(T[:3, 3]))


def test_wrong_tracks_do_not_matter():
    of = rig()
    seen = tracks(of, T, noise_px=0.2, outliers=0.4)
    found = refined_pose(first_pose(seen, of), seen, of)
    # 240 tracks of 0.2 px tell 2.5 m to some millimetres; a plain least-squares fit misses by 0.5 m
    assert np.allclose(found.T_to_from[:3, 3], T[:3, 3], atol=0.03)
    assert np.mean(found.weights < 0.1) == pytest.approx(0.4, abs=0.06)


def test_a_known_offset_is_taken_off():
    of = rig()
    seen = tracks(of, T, offset_px=-0.8)
    x = [(uv[:, 0] - of.left.K[0, 2]) / of.left.K[0, 0] for uv in (seen.uv_from, seen.uv_to)]
    offsets = -0.8 * (1 + np.stack(x) ** 2)
    assert np.allclose(refined_pose(T, seen, of, offset_px=offsets).T_to_from, T, atol=1e-6)
    assert not np.allclose(refined_pose(T, seen, of).T_to_from, T, atol=1e-2)


def test_the_same_pose_each_time():
    of = rig()
    seen = tracks(of, T, noise_px=0.2, outliers=0.5)
    assert np.array_equal(first_pose(seen, of), first_pose(seen, of))


def test_too_few_points_are_no_evidence():
    of = rig()
    seen = tracks(of, T, n=MIN_POINTS - 1)
    assert first_pose(seen, of) is None
    assert refined_pose(T, seen, of) is None


def test_tracks_of_chance_have_no_pose():
    of = rig()
    seen = tracks(of, T, n=60, outliers=1.0)
    rough = first_pose(seen, of)
    assert rough is None or refined_pose(rough, seen, of) is None


def test_derivatives_are_those_of_the_residuals():
    of = rig(doffs_px=5.0)
    seen = tracks(of, T, n=30, noise_px=0.3)
    at = linearised(T, seen, of)
    step = 1e-6
    for axis in range(6):
        twist = np.zeros(6)
        twist[axis] = step
        numeric = (at.error - linearised(exp_twist(twist) @ T, seen, of).error) / step
        assert np.allclose(at.by_pose[:, :, axis], numeric, rtol=1e-3, atol=1e-2)
    offsets = np.array([np.full(30, -step), np.zeros(30)])
    numeric = (at.error - linearised(T, seen, of, offset_px=offsets).error) / step
    assert np.allclose(at.by_seed, numeric, rtol=1e-3, atol=1e-4)


def test_chi2_is_by_the_covariance_of_track_and_seed():
    of = rig()
    at = linearised(T, tracks(of, T, n=25, noise_px=0.5), of)
    S = 0.25**2 * (np.eye(3) + at.by_seed[:, :, None] * at.by_seed[:, None, :])
    by_inverse = np.einsum("ni,nij,nj->n", at.error, np.linalg.inv(S), at.error)
    assert np.allclose(at.chi2, by_inverse)


@pytest.mark.parametrize("forgetting", [True, False])
def test_the_normal_equations_are_those_of_the_residuals(forgetting):
    of, T = rig(doffs_px=31.0, fy_px=710.0), exp_twist(STEP)
    seen = tracks(of, T, noise_px=0.4, outliers=0.2, offset_px=0.3)
    T = exp_twist(np.full(6, 0.01)) @ T
    offset_px = np.random.default_rng(1).normal(0, 0.3, (2, len(seen)))
    at = linearised(T, seen, of, offset_px=offset_px)
    weights = at.weights(forgetting=forgetting)
    by_shape = []
    for x in ((uv[:, 0] - of.left.K[0, 2]) / of.left.K[0, 0] for uv in (seen.uv_from, seen.uv_to)):
        by_shape.append(np.stack([1 + x**2, x**2], axis=1))
    columns = np.concatenate(
        [at.by_pose, -at.by_seed[:, :, None] * by_shape[0][:, None, :]], axis=2
    )
    columns[:, 2, 6:] += by_shape[1]
    weighted = at.whitened(columns) * weights[:, None, None]
    sums = normal_equations(T, seen, of, offset_px=offset_px, forgetting=forgetting)
    assert np.allclose(sums.weights, weights, rtol=1e-9)
    assert np.allclose(sums.H, np.einsum("nij,nik->jk", columns, weighted), rtol=1e-9)
    assert np.allclose(sums.b, np.einsum("nij,ni->j", weighted, at.error), rtol=1e-8, atol=1e-6)
