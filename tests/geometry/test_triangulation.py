import re

import cv2
import numpy as np
import pytest

from pseudolidar.geometry.projection import project
from pseudolidar.geometry.triangulation import (
    corrected_disparity,
    depth_from_disparity,
    depth_per_disparity,
    disparity_from_depth,
    points_by_p,
    points_by_q,
)
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.pose import Pose

# P2 and P3 as KITTI's object and raw layouts publish them for 2011_09_26.
KITTI_P2 = (721.5377, 609.5593, 172.854, (44.85728, 0.2163791, 0.002745884))
KITTI_P3 = (721.5377, 609.5593, 172.854, (-339.5242, 2.199936, 0.002729905))


def rig_of_projections(left, right, size_px) -> StereoRig:
    """Rig of two KITTI projections (f, cx, cy, last column), left camera at its own centre."""
    cameras, centres = [], []
    for (f, cx, cy, last), name in ((left, "camera_left"), (right, "camera_right")):
        K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1.0]])
        cameras.append(Camera(K, *size_px, frame=name))
        centres.append(np.linalg.solve(K, last))
    t_m = centres[1] - centres[0]
    return StereoRig(*cameras, Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m))


def kitti() -> StereoRig:
    return rig_of_projections(KITTI_P2, KITTI_P3, (1242, 375))


def middlebury() -> StereoRig:
    """Motorcycle: principal points 31 px apart."""
    last = (-994.978 * 0.193001, 0.0, 0.0)
    left = (994.978, 311.193, 254.877, (0.0, 0.0, 0.0))
    return rig_of_projections(left, (994.978, 342.279, 254.877, last), (741, 500))


def tilted() -> StereoRig:
    """Right centre 1 cm behind and 2 mm above the left one: as far off as a rig may be."""
    last = (-360.0, -1.4, 0.01)
    return rig_of_projections(
        (700.0, 600.0, 170.0, (0.0, 0.0, 0.0)), (700.0, 604.0, 170.0, last), (1242, 375)
    )


RIGS = {"kitti": kitti, "middlebury": middlebury, "tilted": tilted}


def pixels(rig, n=2000):
    """Random disparities above infinity, columns, rows."""
    rng = np.random.default_rng(3)
    width, height = rig.left.size_px
    d = rng.uniform(0.5, 150.0, n) - rig.doffs_px
    return d, rng.uniform(0, width - 1, n), rng.uniform(0, height - 1, n)


def relative(a, b):
    return np.linalg.norm(a - b, axis=1) / np.linalg.norm(b, axis=1)


@pytest.mark.parametrize("name", RIGS)
def test_q_and_p_agree_to_a_millionth(name):
    rig = RIGS[name]()
    d, u, v = pixels(rig)
    assert relative(points_by_q(d, u, v, rig), points_by_p(d, u, v, rig)).max() < 1e-6


def test_q_and_p_agree_on_the_calibrations_of_the_real_data(real_data):
    calibrations = {
        "kitti_object/training/calib": ("P2:", "P3:"),
        "kitti_odometry": ("P0:", "P1:"),
        "kitti_stereo2015/training/calib_cam_to_cam": ("P_rect_02:", "P_rect_03:"),
    }
    for folder, names in calibrations.items():
        path = sorted((real_data / folder).rglob("*.txt"))
        path = next(p for p in path if all(name in p.read_text() for name in names))
        projections = []
        for name in names:
            row = re.search(re.escape(name) + "(.*)", path.read_text()).group(1)
            P = np.array(row.split(), float).reshape(3, 4)
            projections.append((P[0, 0], P[0, 2], P[1, 2], P[:, 3]))
        rig = rig_of_projections(*projections, (1242, 375))
        d, u, v = pixels(rig)
        assert relative(points_by_q(d, u, v, rig), points_by_p(d, u, v, rig)).max() < 1e-6


@pytest.mark.parametrize("name", RIGS)
def test_points_of_known_depth_come_back(name):
    rig = RIGS[name]()
    rng = np.random.default_rng(4)
    xyz = rng.uniform((-20, -3, 3), (20, 3, 80), (2000, 3))
    left, _ = project(xyz, rig.P_left)
    right, _ = project(xyz, rig.P_right)
    (u, v), d = left.T, left[:, 0] - right[:, 0]
    for triangulate in (points_by_q, points_by_p):
        assert relative(triangulate(d, u, v, rig), xyz).max() < 1e-9
    np.testing.assert_allclose(depth_from_disparity(d, u, rig), xyz[:, 2], rtol=1e-9)
    np.testing.assert_allclose(disparity_from_depth(xyz[:, 2], u, rig), d, rtol=1e-9)


def test_the_forward_offset_matters():
    """Plain Q, as cv2 applies it, is wrong by more than the tolerance on the tilted rig."""
    rig = tilted()
    d, u, v = pixels(rig)
    x, y, z, w = rig.Q @ np.stack([u, v, d, np.ones_like(d)])
    plain = np.stack([x, y, z], axis=1) / w[:, None]
    assert np.median(relative(plain, points_by_p(d, u, v, rig))) > 1e-3


def test_same_points_as_opencv_without_forward_offset():
    rig = middlebury()
    rng = np.random.default_rng(5)
    width, height = rig.left.size_px
    disparity = rng.uniform(5.0, 60.0, (height, width)).astype(np.float32)
    theirs = cv2.reprojectImageTo3D(disparity, rig.Q)
    v, u = np.mgrid[:height, :width].reshape(2, -1).astype(float)
    ours = points_by_q(disparity.ravel().astype(float), u, v, rig)
    assert relative(ours, theirs.reshape(-1, 3)).max() < 1e-6


def test_nothing_beyond_infinity():
    rig = middlebury()
    d = np.array([-31.0861, -40.0, -31.0])
    u = v = np.full(3, 100.0)
    for points in (points_by_q(d, u, v, rig), points_by_p(d, u, v, rig)):
        np.testing.assert_array_equal(np.isfinite(points[:, 2]), [False, False, True])
    np.testing.assert_array_equal(
        np.isfinite(depth_from_disparity(d, u, rig)), [False, False, True]
    )


@pytest.mark.parametrize("name", RIGS)
def test_slope_is_the_derivative_of_depth(name):
    rig = RIGS[name]()
    d, u, _ = pixels(rig)
    step = 1e-5
    numeric = (depth_from_disparity(d - step, u, rig) - depth_from_disparity(d + step, u, rig)) / (
        2 * step
    )
    slope = depth_per_disparity(d, depth_from_disparity(d, u, rig), rig)
    np.testing.assert_allclose(slope, numeric, rtol=1e-6)


def test_correction_is_taken_off():
    correction = DisparityCorrection(np.array([0.5, 1.0, 0, 0, 0, 0, 0, 0.25, 0.1, -0.2]), 0.1)
    rig = kitti()
    d, u, v = np.array([50.0, 25.0]), np.array([0.0, 1241.0]), np.array([10.0, 20.0])
    np.testing.assert_array_equal(corrected_disparity(d, u, v, rig), d)
    x, y = np.array([-1.0, 1.0]), 2 * v / 374 - 1
    expected = d - (0.5 + d / 50.0 + 0.25 * x**3 + 0.1 * x**2 * y - 0.2 * x**4)
    np.testing.assert_allclose(
        corrected_disparity(d, u, v, rig.with_correction(correction)), expected
    )
