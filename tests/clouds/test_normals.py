"""Normals: exact on planes, towards the sensor, and written with the names that readers know."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.clouds.normals import Normals
from pseudolidar.formats.points.pcd import decode_pcd, encode_pcd
from pseudolidar.formats.points.ply import decode_ply, encode_ply
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

T_VELO_CAM = Pose.from_rotation(
    "velodyne", "camera_left", R_BODY_OPTICAL, np.array([0.3, 0.0, -0.1])
)
FOCAL_PX = 200.0


def seen(normal, distance_m, *, height=60, width=90, noise=0.0, seed=0):
    """Pixels of a camera that sees the plane `normal . p = distance_m`, in `velodyne`."""
    v, u = np.mgrid[:height, :width].astype(np.float64)
    rays = np.stack(
        [(u - width / 2) / FOCAL_PX, (v - height / 2) / FOCAL_PX, np.ones_like(u)], axis=-1
    )
    inverse = rays @ normal / distance_m
    inverse += np.random.default_rng(seed).normal(0, noise, inverse.shape)
    xyz = (rays / inverse[..., None]).reshape(-1, 3).astype(np.float32)
    uv = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    cloud = PointCloud(xyz, "camera_left", uv=uv, extra={"kept": np.arange(len(xyz))})
    return cloud.transformed(T_VELO_CAM)


def normals(cloud):
    return np.stack([cloud.extra[name] for name in ("nx", "ny", "nz")], axis=1)


def angle_deg(found, true):
    return np.degrees(np.arccos(np.clip(found @ true, -1, 1)))


PLANES = [
    (np.array([0, 0, 1.0]), 10.0),  # a wall ahead
    (np.array([0, 1.0, 0.08]), 2.4),  # a road
    (np.array([0.6, 0.2, 0.77]), 15.0),
]


@pytest.mark.parametrize(("normal", "distance_m"), PLANES)
@pytest.mark.parametrize("by_pixels", [True, False])
def test_normals_of_planes_are_theirs(normal, distance_m, by_pixels):
    normal = normal / np.linalg.norm(normal)
    cloud = seen(normal, distance_m)
    if not by_pixels:
        cloud = PointCloud(cloud.xyz, "velodyne")
    out, figures = Normals().load()(cloud, (T_VELO_CAM,))
    found = normals(out)
    known = np.isfinite(found[:, 0]) & (cloud.xyz[:, 0] > 0) & (cloud.xyz[:, 0] < 60)
    assert known.mean() > 0.15  # half the picture is above the horizon of the road
    true = -T_VELO_CAM.matrix[:3, :3] @ normal  # to the camera's side
    assert np.quantile(angle_deg(found[known], true), 0.99) < 1.0
    np.testing.assert_allclose(np.linalg.norm(found[known], axis=1), 1, rtol=1e-5)
    assert figures["points_normal"] == np.isfinite(found[:, 0]).sum()


def test_pixels_beat_space_where_depth_is_noisy():
    """A wall at 20 m with the noise of stereo."""
    normal = np.array([0.0, 0, 1])
    cloud = seen(normal, 20.0, noise=3e-4)
    true = -T_VELO_CAM.matrix[:3, :3] @ normal
    by_pixels = normals(Normals().load()(cloud, (T_VELO_CAM,))[0])
    in_space = normals(Normals().load()(PointCloud(cloud.xyz, "velodyne"), ())[0])
    errors = [np.nanmedian(angle_deg(found, true)) for found in (by_pixels, in_space)]
    assert errors[0] < 0.5 * errors[1]


def test_no_normal_bridges_a_step():
    """Left a wall at 5 m, right one at 10 m: each pixel's normal is one wall's, not between."""
    near, far = seen(np.array([0, 0, 1.0]), 5.0), seen(np.array([0, 0, 1.0]), 10.0)
    left = near.uv[:, 0] < 45
    xyz = np.where(left[:, None], near.xyz, far.xyz)
    cloud = PointCloud(xyz, "velodyne", uv=near.uv)
    found = normals(Normals().load()(cloud, (T_VELO_CAM,))[0])
    known = np.isfinite(found[:, 0])
    assert known.mean() > 0.8
    assert angle_deg(found[known], np.array([-1.0, 0, 0])).max() < 1.0


def test_normals_point_to_the_sensor_and_columns_stay():
    cloud = seen(np.array([0, 1.0, 0.08]), 2.4)
    out, _ = Normals().load()(cloud, (T_VELO_CAM,))
    found, known = normals(out), np.isfinite(out.extra["nx"])
    to_sensor = T_VELO_CAM.translation_m - cloud.xyz
    assert ((found * to_sensor).sum(axis=1)[known] > 0).all()
    np.testing.assert_array_equal(out.extra["kept"], cloud.extra["kept"])
    assert "nx" not in cloud.extra


def test_holes_have_no_normal_and_lines_neither():
    cloud = seen(np.array([0, 0, 1.0]), 10.0)
    xyz = cloud.xyz.copy()
    xyz[::3] = np.nan
    organised = PointCloud(xyz, "velodyne", uv=cloud.uv, shape=(60, 90))
    found = normals(Normals().load()(organised, (T_VELO_CAM,))[0])
    assert np.isnan(found[::3]).all()
    assert np.isfinite(found).all(axis=1).sum() > 2000
    line = np.column_stack([np.linspace(1, 9, 200), np.zeros((200, 2))]).astype(np.float32)
    assert np.isnan(normals(Normals().load()(PointCloud(line, "velodyne"), ())[0])).all()
    empty = PointCloud(np.zeros((0, 3), np.float32), "velodyne")
    assert len(normals(Normals().load()(empty, ())[0])) == 0


@pytest.mark.parametrize("encoding", ["binary", "ascii", "binary_compressed"])
def test_pcd_and_ply_name_them_as_their_readers_do(encoding):
    cloud = seen(np.array([0, 0, 1.0]), 10.0, height=20, width=30)
    out, _ = Normals().load()(cloud, (T_VELO_CAM,))
    pcd = encode_pcd(out, encoding=encoding)
    assert b"normal_x normal_y normal_z" in pcd[:800]
    ply = encode_ply(out)
    assert b"property float nx" in ply[:1200]
    for again in (decode_pcd(pcd), decode_ply(ply)):
        np.testing.assert_allclose(normals(again), normals(out), rtol=1e-6)
        assert list(again.extra) == list(out.extra)


def test_a_pcd_with_both_names_keeps_both():
    xyz = np.zeros((3, 3), np.float32)
    extra = {"nx": np.arange(3, dtype=np.float32), "normal_x": np.ones(3, np.float32)}
    again = decode_pcd(encode_pcd(PointCloud(xyz, "velodyne", extra=extra)))
    np.testing.assert_array_equal(again.extra["nx"], extra["nx"])
    np.testing.assert_array_equal(again.extra["normal_x"], extra["normal_x"])


def test_open3d_reads_the_normals(tmp_path):
    from pseudolidar.geometry.open3d_library import load_open3d

    o3d = load_open3d()
    cloud = seen(np.array([0, 0, 1.0]), 10.0, height=20, width=30)
    out, _ = Normals().load()(PointCloud(cloud.xyz, "velodyne"), ())
    for name, data in (("a.pcd", encode_pcd(out)), ("a.ply", encode_ply(out))):
        (tmp_path / name).write_bytes(data)
        read = o3d.io.read_point_cloud(str(tmp_path / name))
        assert read.has_normals(), name
        np.testing.assert_allclose(np.asarray(read.normals), normals(out), atol=1e-6)
