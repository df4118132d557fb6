import numpy as np
import pytest

from pseudolidar.errors import CalibrationField
from pseudolidar.geometry.projection import Occluders, project, project_scan, visible
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.pose import Pose

K = np.array([[100.0, 0, 50.0], [0, 100.0, 40.0], [0, 0, 1]])


def rig(T_left_velodyne=None) -> StereoRig:
    cameras = Camera(K, 101, 81), Camera(K, 101, 81, frame="camera_right")
    baseline = Pose.from_rotation(
        "camera_right", "camera_left", np.eye(3), np.array([-0.5, 0.0, 0.0])
    )
    return StereoRig(*cameras, baseline, T_left_velodyne=T_left_velodyne)


def wall(depth_m, low_px, high_px, step_px=2):
    """Points of a fronto-parallel wall that covers pixels [low, high) in both directions."""
    u, v = np.meshgrid(np.arange(low_px, high_px, step_px), np.arange(low_px, high_px, step_px))
    rays = np.stack([(u - 50) / 100, (v - 40) / 100, np.ones_like(u, float)], axis=-1)
    return (rays.reshape(-1, 3) * depth_m).astype(np.float32)


def test_pixels_and_depths():
    uv, depth_m = project(np.array([[1.0, 2.0, 10.0], [0, 0, -5.0]]), rig().P_left)
    np.testing.assert_allclose(uv[0], [60.0, 60.0])
    assert np.isnan(uv[1]).all()
    np.testing.assert_allclose(depth_m, [10.0, -5.0])


def test_points_behind_a_nearer_surface_are_dropped():
    near, far = wall(5.0, 20, 40), wall(20.0, 10, 60)
    scan = LidarScan(np.concatenate([near, far]), frame="camera_left")
    seen = project_scan(scan, rig(), occluders=Occluders(2, 2, 2))
    assert set(range(len(near))) <= set(seen.index)
    background = seen.uv[seen.depth_m > 10]
    inside = ((background >= 18) & (background <= 40)).all(axis=1)
    assert not inside.any()
    assert len(background) == 25 * 25 - 12 * 12


def test_a_sloped_surface_does_not_hide_itself():
    """Ground seen from 1.7 m, to 40 m."""
    x, z = np.meshgrid(np.arange(-3.0, 3.0, 0.1), np.geomspace(5.0, 40.0, 64))
    ground = np.stack([x, np.full_like(x, 1.7), z], axis=-1).reshape(-1, 3).astype(np.float32)
    seen = project_scan(LidarScan(ground, frame="camera_left"), rig(), occluders=Occluders(1, 1, 1))
    inside, _ = project(ground, rig().P_left)
    count = np.sum((np.rint(inside) >= 0).all(axis=1) & (np.rint(inside) <= (100, 80)).all(axis=1))
    assert len(seen.index) > 0.5 * count


@pytest.mark.parametrize("above", [0, 2, 3])
@pytest.mark.parametrize("below", [0, 1, 4])
def test_the_window_reaches_as_far_as_it_says(above, below):
    rows = np.arange(40)
    uv = np.stack([np.full(40, 50.0), rows], axis=1)
    depth_m = np.where(rows == 20, 5.0, 10.0)
    hidden = rows[~visible(uv, depth_m, (101, 81), occluders=Occluders(above, below, 1))]
    # The near point of row 20 hides those that have it among the rows above or below them.
    np.testing.assert_array_equal(hidden, [r for r in range(20 - below, 21 + above) if r != 20])


def test_points_outside_or_behind_are_dropped():
    xyz = np.array([[0, 0, 10.0], [0, 0, -10.0], [20.0, 0, 10.0], [-5.04, 0, 10.0]], np.float32)
    seen = project_scan(LidarScan(xyz, frame="camera_left"), rig())
    np.testing.assert_array_equal(seen.index, [0, 3])


def test_scans_are_brought_into_the_camera():
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    pose = Pose.from_rotation("camera_left", "velodyne", axes, np.array([0.0, 0.1, -0.3]))
    seen = project_scan(LidarScan(np.array([[10.3, 0.0, 0.1]], np.float32)), rig(pose))
    np.testing.assert_allclose(seen.depth_m, [10.0], rtol=1e-6)
    np.testing.assert_allclose(seen.uv, [[50.0, 40.0]], atol=1e-4)
    with pytest.raises(CalibrationField):
        project_scan(LidarScan(np.zeros((1, 3), np.float32)), rig())
