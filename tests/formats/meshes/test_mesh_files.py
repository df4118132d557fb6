import contextlib
import io
import json
import struct

import numpy as np
import plyfile
import pytest
import trimesh

from pseudolidar.errors import MeshIndex, PointFileCorrupt, PointFileTruncated, PseudolidarError
from pseudolidar.formats.meshes.glb import encode_glb
from pseudolidar.formats.meshes.glb_reader import decode_glb
from pseudolidar.formats.meshes.mesh_file import ENCODERS, read_mesh
from pseudolidar.formats.meshes.obj import decode_obj
from pseudolidar.formats.meshes.ply import decode_ply_mesh, encode_ply_mesh
from pseudolidar.structures.mesh import Mesh


@pytest.fixture
def hill() -> Mesh:
    """A wavy square, coloured."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:5, 0:6].astype(np.float32)
    vertices = np.stack([x, y, np.sin(x) * 0.3], axis=-1).reshape(-1, 3)
    corner = (np.arange(4)[:, None] * 6 + np.arange(5)).ravel()
    lower = np.stack([corner, corner + 1, corner + 6], axis=1)
    upper = np.stack([corner + 1, corner + 7, corner + 6], axis=1)
    normals = np.tile(np.float32([0, 0, 1]), (len(vertices), 1))
    rgb = rng.integers(0, 256, (len(vertices), 3), np.uint8)
    return Mesh(vertices, np.concatenate([lower, upper]).astype(np.int32), "map", rgb, normals)


@pytest.mark.parametrize("name", ENCODERS)
def test_a_mesh_comes_back_with_its_colours_and_frame(hill, tmp_path, name):
    path = tmp_path / f"hill.{name}"
    path.write_bytes(ENCODERS[name](hill))
    back = read_mesh(path)
    assert np.allclose(back.vertices, hill.vertices, atol=1e-6)
    assert np.array_equal(back.triangles, hill.triangles)
    assert np.array_equal(back.rgb, hill.rgb)
    assert back.frame == "map"


@pytest.mark.parametrize("name", ENCODERS)
def test_another_reader_finds_the_same_surface(hill, name):
    """GLB is y up by its specification: z of the map is y there."""
    theirs = trimesh.load(io.BytesIO(ENCODERS[name](hill)), file_type=name, force="mesh")
    corners = hill.corners
    if name == "glb":
        corners = corners[..., [0, 2, 1]] * [1, 1, -1]
    assert np.allclose(np.sort(theirs.triangles, axis=0), np.sort(corners, axis=0), atol=1e-5)
    assert theirs.area == pytest.approx(hill.areas_m2.sum(), rel=1e-5)


def test_glb_holds_places_far_from_the_origin_to_a_millimetre(hill):
    far = Mesh(hill.vertices + np.array([450_000.0, 5_400_000.0, 100.0]), hill.triangles, "map")
    assert np.abs(decode_glb(encode_glb(far)).vertices - far.vertices).max() < 1e-3


@pytest.mark.parametrize("name", ENCODERS)
def test_a_cut_file_is_never_a_smaller_mesh(hill, tmp_path, name):
    whole = ENCODERS[name](hill)
    path = tmp_path / f"cut.{name}"
    for end in (0, 3, 15, 19, 60, 200, len(whole) // 2, len(whole) - 9, len(whole) - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(PseudolidarError) as caught:
            read_mesh(path)
        assert caught.value.path == str(path)


@pytest.mark.parametrize("name", ENCODERS)
def test_damaged_bytes_never_raise_anything_else(hill, tmp_path, name):
    whole, rng = ENCODERS[name](hill), np.random.default_rng(5)
    path = tmp_path / f"bad.{name}"
    for _ in range(150):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 3):
            data[at] = rng.integers(0, 256)
        path.write_bytes(data)
        with contextlib.suppress(PseudolidarError):
            read_mesh(path)


def test_obj_that_was_cut_between_two_lines_is_found_out_by_its_counts(hill):
    whole = ENCODERS["obj"](hill)
    with pytest.raises(PointFileTruncated):
        decode_obj(whole[: whole[:-1].rindex(b"\n") + 1])


def test_faces_of_four_corners_become_two_triangles():
    square = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2/2 3/3 -1/4\n"
    assert decode_obj(square).triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    vertices = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "f4,f4,f4")
    vertices.dtype.names = ("x", "y", "z")
    faces = np.array([([0, 1, 2, 3],)], [("vertex_indices", "i4", (4,))])
    for text in (False, True):
        elements = [plyfile.PlyElement.describe(vertices, "vertex")]
        elements.append(plyfile.PlyElement.describe(faces, "face"))
        file = io.BytesIO()
        plyfile.PlyData(elements, text=text).write(file)
        mesh = decode_ply_mesh(file.getvalue())
        assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_a_face_of_a_vertex_that_is_not_there_is_named():
    with pytest.raises(MeshIndex, match="face 0"):
        decode_obj(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 4\n")


def test_a_cloud_is_no_mesh(hill):
    data = encode_ply_mesh(Mesh(hill.vertices, hill.triangles[:0], "map"))
    with pytest.raises(PointFileCorrupt, match="no face"):
        decode_ply_mesh(data)


@pytest.mark.parametrize("encoding", ["binary_little_endian", "ascii"])
def test_faces_of_nothing_are_no_faces(encoding):
    vertices = "element vertex 1\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat {encoding} 1.0\n{vertices}element face 1\nend_header\n".encode()
    body = b"0 0 0\n" if encoding == "ascii" else bytes(12)
    with pytest.raises(PointFileCorrupt, match="no face"):
        decode_ply_mesh(head + body)


def test_a_face_of_a_vertex_beyond_all_numbers_is_named():
    with pytest.raises(PointFileCorrupt, match="line 2"):
        decode_obj(b"v 0 0 0\nf 99999999999999999999 2 3\n")


def test_an_empty_mesh_is_legal_glb(hill):
    data = encode_glb(hill.only(np.zeros(len(hill), bool)))
    size = struct.unpack_from("<I", data, 12)[0]
    assert json.loads(data[20 : 20 + size])["asset"]["version"] == "2.0"
