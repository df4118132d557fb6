"""What other people's readers make of our files, and we of theirs."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import plyfile
import pypcd4
import pytest

from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.pcd import decode_pcd, encode_pcd, read_pcd
from pseudolidar.formats.points.ply import decode_ply, encode_ply, read_ply
from pseudolidar.geometry.open3d_library import load_open3d

PCD_ENCODINGS = ("binary", "binary_compressed", "ascii")
PLY_ENCODINGS = ("binary_little_endian", "ascii")
FILES = [
    *[(encode_pcd, "pcd", encoding) for encoding in PCD_ENCODINGS],
    *[(encode_ply, "ply", encoding) for encoding in PLY_ENCODINGS],
]


@pytest.fixture(scope="module")
def o3d():
    return load_open3d()


@pytest.fixture(scope="module")
def cloud(make_cloud):
    """Every column of a converted frame, and extras of types that open3d has in PLY too."""
    whole = make_cloud(60)
    return replace(whole, extra={n: whole.extra[n] for n in ("of_int32", "of_float64")})


@pytest.fixture(params=FILES, ids=lambda f: f"{f[1]}-{f[2]}")
def file(request, cloud, tmp_path):
    encode, extension, encoding = request.param
    path = tmp_path / f"cloud.{extension}"
    path.write_bytes(encode(cloud, encoding=encoding))
    return path


def test_open3d_legacy(o3d, file, cloud):
    read = o3d.io.read_point_cloud(str(file), remove_nan_points=False)
    # In text, 9 digits are the float32 exactly, but not the double that is nearest to it.
    np.testing.assert_array_equal(np.asarray(read.points).astype(np.float32), cloud.xyz)
    np.testing.assert_array_equal(np.rint(np.asarray(read.colors) * 255), cloud.rgb)


def test_open3d_tensor(o3d, file, cloud):
    read = o3d.t.io.read_point_cloud(str(file), remove_nan_points=False)
    np.testing.assert_array_equal(read.point.positions.numpy(), cloud.xyz)
    np.testing.assert_array_equal(read.point.colors.numpy(), cloud.rgb)
    prefix = "scalar_" if file.suffix == ".ply" else ""
    wanted = {
        "intensity": cloud.intensity,
        prefix + "sigma_m": cloud.sigma_m,
        prefix + "u": cloud.uv[:, 0],
        prefix + "v": cloud.uv[:, 1],
        prefix + "of_int32": cloud.extra["of_int32"],
        prefix + "of_float64": cloud.extra["of_float64"],
    }
    for name, column in wanted.items():
        np.testing.assert_array_equal(read.point[name].numpy()[:, 0], column, err_msg=name)


@pytest.mark.parametrize("encoding", PCD_ENCODINGS)
def test_pypcd4(make_cloud, tmp_path, encoding):
    cloud = make_cloud(60)
    path = tmp_path / "cloud.pcd"
    path.write_bytes(encode_pcd(cloud, encoding=encoding))
    read = pypcd4.PointCloud.from_path(path)
    np.testing.assert_array_equal(read.numpy(("x", "y", "z")), cloud.xyz)
    packed = read.pc_data["rgb"].view(np.uint32)
    np.testing.assert_array_equal(packed >> 16 & 255, cloud.rgb[:, 0])
    for name in ("intensity", "sigma_m"):
        np.testing.assert_array_equal(read.pc_data[name], getattr(cloud, name))
    for name, column in cloud.extra.items():
        np.testing.assert_array_equal(read.pc_data[name], column, err_msg=name)


@pytest.mark.parametrize("encoding", PLY_ENCODINGS)
def test_plyfile(make_cloud, encoding):
    cloud = make_cloud(60, shape=(6, 10))
    read = plyfile.PlyData.read(io.BytesIO(encode_ply(cloud, encoding=encoding)))
    vertex = read["vertex"].data
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(vertex[name], cloud.xyz[:, axis])
    np.testing.assert_array_equal(vertex["green"], cloud.rgb[:, 1])
    np.testing.assert_array_equal(vertex["intensity"], cloud.intensity)
    np.testing.assert_array_equal(vertex["scalar_v"], cloud.uv[:, 1])
    for name in ("of_uint8", "of_int32", "of_float64"):
        assert vertex["scalar_" + name].dtype == cloud.extra[name].dtype
        np.testing.assert_array_equal(vertex["scalar_" + name], cloud.extra[name])
    assert "pseudolidar shape [6, 10]" in read.comments


# --- their files ---------------------------------------------------------------------------


def o3d_cloud(o3d, cloud):
    made = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.xyz.astype(float)))
    made.colors = o3d.utility.Vector3dVector(cloud.rgb / 255)
    return made


@pytest.mark.parametrize("ascii_", [True, False])
@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize(("extension", "read"), [("pcd", read_pcd), ("ply", read_ply)])
def test_files_of_open3d(o3d, cloud, tmp_path, ascii_, compressed, extension, read):
    path = tmp_path / f"theirs.{extension}"
    made = o3d_cloud(o3d, cloud)
    assert o3d.io.write_point_cloud(str(path), made, write_ascii=ascii_, compressed=compressed)
    got = read(path)
    digits = 1e-5 if ascii_ else 0  # it writes 6 digits in PLY
    np.testing.assert_allclose(got.xyz, cloud.xyz, rtol=digits)
    if not (ascii_ and extension == "pcd"):  # there it writes too few digits for the bits
        np.testing.assert_array_equal(got.rgb, cloud.rgb)


@pytest.mark.parametrize("encoding", list(pypcd4.Encoding)[:3])
def test_files_of_pypcd4(cloud, tmp_path, encoding):
    path = tmp_path / "theirs.pcd"
    rgb = pypcd4.PointCloud.encode_rgb(cloud.rgb)
    columns = (*cloud.xyz.T, rgb, cloud.extra["of_int32"])
    kinds = (np.float32,) * 4 + (np.int32,)
    made = pypcd4.PointCloud.from_points(columns, ("x", "y", "z", "rgb", "ring"), kinds)
    made.save(path, encoding=encoding)
    got = read_pcd(path)
    np.testing.assert_allclose(got.xyz, cloud.xyz, rtol=1e-6)
    np.testing.assert_array_equal(got.extra["ring"], cloud.extra["of_int32"])
    if encoding != pypcd4.Encoding.ASCII:  # there it writes zeros
        np.testing.assert_array_equal(got.rgb, cloud.rgb)


@pytest.mark.parametrize(("text", "order"), [(True, "="), (False, "<"), (False, ">")])
def test_files_of_plyfile(cloud, text, order):
    vertex = np.zeros(60, [("x", "f8"), ("y", "f8"), ("z", "f8"), ("ring", "i4")])
    vertex["x"], vertex["y"], vertex["z"] = cloud.xyz.T
    vertex["ring"] = cloud.extra["of_int32"]
    face = np.zeros(3, [("vertex_indices", object), ("quality", "f4")])
    for i, count in enumerate((3, 5, 4)):
        face["vertex_indices"][i] = np.arange(count)
    elements = [
        plyfile.PlyElement.describe(face, "face"),
        plyfile.PlyElement.describe(vertex, "vertex"),
    ]
    buffer = io.BytesIO()
    plyfile.PlyData(elements, text=text, byte_order=order).write(buffer)
    got = decode_ply(buffer.getvalue())
    assert got.xyz.dtype == np.float64
    np.testing.assert_array_equal(got.xyz, cloud.xyz)
    np.testing.assert_array_equal(got.extra["ring"], cloud.extra["of_int32"])


def test_mesh_of_open3d(o3d, tmp_path):
    path = tmp_path / "mesh.ply"
    mesh = o3d.geometry.TriangleMesh.create_sphere(resolution=5)
    mesh.compute_vertex_normals()
    assert o3d.io.write_triangle_mesh(str(path), mesh)
    got = read_ply(path)
    np.testing.assert_array_equal(got.xyz, np.asarray(mesh.vertices))
    assert list(got.extra) == ["nx", "ny", "nz"]
    data = path.read_bytes()
    again = decode_ply(encode_ply(got))
    np.testing.assert_array_equal(again.extra["nz"], got.extra["nz"])
    np.testing.assert_array_equal(decode_pcd(encode_pcd(got)).xyz, got.xyz)
    assert b"property double nz" in encode_ply(got)
    assert len(data) > len(encode_ply(got))


@pytest.mark.parametrize("colours", ["uint8", "float32"])
def test_npz_of_open3d(o3d, cloud, tmp_path, colours):
    made = o3d.t.geometry.PointCloud(cloud.xyz)
    rgb = cloud.rgb if colours == "uint8" else cloud.rgb.astype(np.float32) / 255
    made.point.colors = np.ascontiguousarray(rgb)
    made.point.intensity = cloud.intensity[:, None].copy()
    made.point.normals = -cloud.xyz
    made.point["ring"] = np.arange(len(cloud), dtype=np.uint16)[:, None].copy()
    o3d.t.io.write_point_cloud(str(tmp_path / "a.npz"), made)
    read = read_npz(tmp_path / "a.npz")
    for name in ("xyz", "rgb", "intensity"):
        np.testing.assert_array_equal(getattr(read, name), getattr(cloud, name))
        assert getattr(read, name).dtype == getattr(cloud, name).dtype
    np.testing.assert_array_equal(read.extra["ring"], np.arange(len(cloud)))
    assert read.extra["ring"].dtype == np.uint16
    np.testing.assert_array_equal(read.extra["ny"], -cloud.xyz[:, 1])
