"""The rig: what is rectified, its two projections and Q, and images of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import CalibrationSizeMismatch, CalibrationValue, NotRectified
from pseudolidar.structures.camera import UNREFINED_SIGMA_PX, Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.pose import Pose
from tests.raw_rigs import raw_rig

WIDTH, HEIGHT = 640, 480


def intrinsics(*, fx=500.0, fy=500.0, cx=320.0, cy=240.0, skew=0.0):
    return np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])


def rig(left=None, right=None, *, t_m=(-0.5, 0.0, 0.0), R=None, **more) -> StereoRig:
    return StereoRig(
        Camera(intrinsics(**(left or {})), WIDTH, HEIGHT, frame="camera_left"),
        Camera(intrinsics(**(right or left or {})), WIDTH, HEIGHT, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3) if R is None else R, t_m),
        **more,
    )


def turned(angle_rad: float):
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    "given",
    [
        rig(),
        rig(right={"cx": 330.0}),
        rig({"fx": 500.0, "fy": 650.0}),
        rig(t_m=(-0.5, 0.002, -0.003)),
    ],
    ids=["plain", "doffs", "pixels that are not square", "KITTI's small offsets"],
)
def test_rectified(given):
    assert given.is_rectified


@pytest.mark.parametrize(
    "given",
    [
        rig(right={"cy": 241.0}),
        rig(right={"fx": 501.0}),
        rig(right={"fy": 501.0}),
        rig({"skew": 2.0}),
        rig(t_m=(-0.5, 0.05, 0.0)),
        rig(R=turned(0.01)),
    ],
    ids=["rows", "focal length", "focal length along columns", "skew", "height", "roll"],
)
def test_not_rectified(given):
    assert not given.is_rectified
    with pytest.raises(NotRectified):
        _ = given.Q


def test_lens_distortion_is_not_rectified():
    given = rig()
    bent = replace(given.left, distortion=np.array([0.1, 0, 0, 0, 0]))
    assert not replace(given, left=bent).is_rectified


def test_a_fisheye_is_not_rectified_though_its_coefficients_are_zero():
    given = rig()
    eyes = (replace(eye, model="fisheye") for eye in (given.left, given.right))
    assert not StereoRig(*eyes, given.T_right_left).is_rectified


def test_eyes_of_two_sizes_are_not_rectified():
    given = rig()
    assert not replace(given, right=replace(given.right, width_px=WIDTH + 2)).is_rectified


@pytest.mark.parametrize("t_m", [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)], ids=["none", "exchanged"])
def test_impossible_baselines_are_refused(t_m):
    with pytest.raises(CalibrationValue, match="baseline"):
        rig(t_m=t_m)


@pytest.mark.parametrize("given", [{"fx": -1.0}, {"fy": 0.0}, {"cx": 640.0}, {"cy": -1.0}])
def test_impossible_intrinsics_are_refused(given):
    with pytest.raises(CalibrationValue):
        Camera(intrinsics(**given), WIDTH, HEIGHT)


@pytest.mark.parametrize("given", [{}, {"fx": 500.0, "fy": 650.0}])
def test_q_inverts_the_two_projections(given):
    one = rig(given, given | {"cx": 335.0})
    point = np.array([1.5, -0.7, 12.0, 1.0])
    left, right = one.P_left @ point, one.P_right @ point
    u, v = left[:2] / left[2]
    d = u - right[0] / right[2]
    assert right[1] / right[2] == pytest.approx(v)
    x, y, z, w = one.Q @ (u, v, d, 1.0)
    np.testing.assert_allclose((x / w, y / w, z / w), point[:3], rtol=1e-12)
    assert d == pytest.approx(one.fB_px_m / 12.0 - one.doffs_px)
    assert one.baseline_m == pytest.approx(0.5)


def test_pixels_of_resized_images_keep_their_rays():
    """The centre of the corner pixel is at (-0.25, -0.25) of an image of twice the size."""
    small, large = rig(right={"cx": 335.0}), rig(right={"cx": 335.0}).scaled_to(1280, 960)
    point = np.array([1.5, -0.7, 12.0, 1.0])
    for name in ("P_left", "P_right"):
        x, y, z = getattr(small, name) @ point
        X, Y, Z = getattr(large, name) @ point
        np.testing.assert_allclose((X / Z + 0.5, Y / Z + 0.5), (2 * (x / z + 0.5), 2 * y / z + 1))
    assert large.baseline_m == pytest.approx(small.baseline_m)
    assert large.doffs_px == pytest.approx(2 * small.doffs_px)


def test_eyes_of_two_sizes_are_resized_by_the_same_ratios():
    raw = raw_rig(5, right_px=(320, 240))
    large = raw.scaled_to(1280, 1440)
    assert (large.left.size_px, large.right.size_px) == ((1280, 1440), (640, 720))
    for name in ("left", "right"):
        before, after = getattr(raw, name), getattr(large, name)
        np.testing.assert_allclose(np.diag(after.K), np.diag(before.K) * [2, 3, 1])
        np.testing.assert_allclose(after.K[:2, 2] + 0.5, (before.K[:2, 2] + 0.5) * [2, 3])
        np.testing.assert_array_equal(after.distortion, before.distortion)


def test_correction_grows_with_the_images():
    coefficients = np.array([0.3, -0.2, 0.1, 0.05, -0.04, 0.03, 0.02, -0.01, 0.02, 0.01])
    correction = DisparityCorrection(coefficients, residual_px=0.2)
    small = rig(correction=correction)
    large = small.scaled_to(2 * WIDTH, 2 * HEIGHT)
    # Columns and rows as shares of the image: the correction has no finer position.
    x, y = np.array([0.1, 0.9]), np.array([0.2, 0.7])
    d = np.array([10.0, 80.0])
    near, far = (
        one.correction.offset_px(
            scale * d, x * (one.left.width_px - 1), y * (one.left.height_px - 1), one.left.size_px
        )
        for one, scale in ((small, 1.0), (large, 2.0))
    )
    np.testing.assert_allclose(far, 2 * near)
    assert large.systematic_sigma_px == pytest.approx(0.4)
    assert rig().systematic_sigma_px == UNREFINED_SIGMA_PX


def test_images_of_another_size_are_refused():
    rig().check_size(WIDTH, HEIGHT)
    with pytest.raises(CalibrationSizeMismatch, match="640x480"):
        rig().check_size(HEIGHT, WIDTH)


def test_a_lidar_is_raised_once():
    """On the rig that knows of it, and on a source whose own LiDAR is as it was calibrated."""
    pitch_rad = 0.01
    ahead = Pose("camera_left", "velodyne", np.eye(4))
    bare, own = rig(), rig(T_left_velodyne=ahead)
    knowing = own.with_lidar_raised(pitch_rad)
    assert knowing.lidar_pitch_rad == pitch_rad
    up = knowing.T_left_velodyne.apply(np.array([[0.0, 0.0, 10.0]]))[0]
    np.testing.assert_allclose(up, [0, -10 * np.sin(pitch_rad), 10 * np.cos(pitch_rad)], rtol=1e-12)
    np.testing.assert_array_equal(knowing.lidar_of(own).matrix, knowing.T_left_velodyne.matrix)
    np.testing.assert_array_equal(knowing.lidar_of(bare).matrix, knowing.T_left_velodyne.matrix)
    twice = knowing.with_lidar_raised(pitch_rad)
    assert twice.lidar_pitch_rad == 2 * pitch_rad
    np.testing.assert_allclose(twice.T_left_velodyne.matrix, twice.lidar_of(own).matrix, atol=1e-12)
