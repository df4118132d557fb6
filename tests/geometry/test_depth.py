import numpy as np
import pytest

from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.triangulation import corrected_disparity, depth_from_disparity
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose


def rig(*, correction=None, doffs_px=0.0):
    K = np.array([[700.0, 0, 60], [0, 700, 20], [0, 0, 1]])
    right = K.copy()
    right[0, 2] += doffs_px
    t_m = np.array([-0.54, 0, 0.002])
    T_right_left = Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m)
    left, right = Camera(K, 120, 40), Camera(right, 120, 40, frame="camera_right")
    return StereoRig(left, right, T_right_left, correction=correction)


@pytest.mark.parametrize("doffs_px", [0.0, 30.0, -3.0])
@pytest.mark.parametrize("corrected", [False, True])
def test_is_the_exact_depth_in_single_precision(doffs_px, corrected):
    coefficients = np.array([0.3, 0.1, 0.05, -0.04, 0.02, 0.01, -0.02, 0.03, 0.02, -0.02])
    here = rig(
        correction=DisparityCorrection(coefficients, 0.1) if corrected else None,
        doffs_px=doffs_px,
    )
    values = np.random.default_rng(1).uniform(5, 100, (40, 120)).astype(np.float32)
    values[::3, ::5] = np.nan
    v, u = np.indices(values.shape, np.float64)
    d = corrected_disparity(values.ravel().astype(float), u.ravel(), v.ravel(), here)
    exact = depth_from_disparity(d, u.ravel(), here).reshape(values.shape)
    depth = depth_map(DisparityMap(values), here)
    assert depth.values.dtype == np.float32
    # A disparity in single precision is known to 1e-7 of its 100 px.
    assert np.allclose(depth.values, exact, rtol=2e-6, equal_nan=True)
    assert np.array_equal(depth.valid, np.isfinite(values))


def test_at_infinity_there_is_no_depth():
    values = np.array([[3.0, 2.9, 5.0]], np.float32)
    depth = depth_map(DisparityMap(values), rig(doffs_px=-3.0))
    assert np.array_equal(depth.valid, [[False, False, True]])
