from __future__ import annotations

import struct

import numpy as np
import pytest

from pseudolidar.errors import (
    LimitError,
    MeshIndex,
    PointFileCorrupt,
    PointFileField,
    PointFileHeader,
    PointFileTruncated,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.points.pcd import encode_pcd
from pseudolidar.formats.points.ply import decode_ply, encode_ply, read_ply

XYZ = ("property float x", "property float y", "property float z")
POINTS = np.array([[1.5, 2, 3], [-4, 5.25, 1e-3]], np.float32)


def ply(*lines: str, body: bytes, encoding: str = "binary_little_endian", end: str = "\n") -> bytes:
    header = ["ply", f"format {encoding} 1.0", *lines, "end_header"]
    return "".join(line + end for line in header).encode() + body


def points_ply(body: bytes = POINTS.tobytes(), **options: str) -> bytes:
    return ply("element vertex 2", *XYZ, body=body, **options)


def test_header_of_a_written_file(make_cloud):
    header = encode_ply(make_cloud()).split(b"end_header\n")[0].decode().splitlines()
    assert header[:4] == [
        "ply",
        "format binary_little_endian 1.0",
        'comment pseudolidar frame "camera_left"',
        "comment pseudolidar timestamp_ns 1317384506123456789",
    ]
    properties = [line.removeprefix("property ") for line in header if line.startswith("property")]
    assert properties[:10] == [
        "float x", "float y", "float z", "uchar red", "uchar green", "uchar blue",
        "float intensity", "float scalar_sigma_m", "float scalar_u", "float scalar_v",
    ]  # fmt: skip
    assert {line.split()[0] for line in properties} <= {
        "char", "uchar", "short", "ushort", "int", "uint", "float", "double",
    }  # fmt: skip


# --- files of others -----------------------------------------------------------------------


def test_plain_file_of_others():
    cloud = decode_ply(points_ply())
    np.testing.assert_array_equal(cloud.xyz, POINTS)
    assert (cloud.frame, cloud.timestamp_ns, cloud.shape) == ("unknown", 0, None)


@pytest.mark.parametrize("end", ["\n", "\r\n", "  \n"])
def test_line_ends_comments_and_obj_info(end):
    data = ply(
        "comment made by hand", "obj_info num_cols 512", "comment", "element vertex 2", *XYZ,
        body=POINTS.tobytes(), end=end,
    )  # fmt: skip
    np.testing.assert_array_equal(decode_ply(data).xyz, POINTS)


def test_big_endian():
    record = np.dtype([("x", ">f8"), ("y", ">f8"), ("z", ">f8"), ("ring", ">u2")])
    rows = np.zeros(2, record)
    rows["x"], rows["y"], rows["z"] = POINTS.T
    rows["ring"] = (1, 60000)
    lines = [f"property double {axis}" for axis in "xyz"] + ["property uint16 ring"]
    encoding = "binary_big_endian"
    cloud = decode_ply(ply("element vertex 2", *lines, body=rows.tobytes(), encoding=encoding))
    np.testing.assert_array_equal(cloud.xyz, POINTS)
    assert cloud.xyz.dtype == np.float64
    assert cloud.extra["ring"].tolist() == [1, 60000]
    assert cloud.extra["ring"].dtype.isnative


def faces(counts: list[int], order: str = "<") -> bytes:
    return b"".join(struct.pack(f"{order}B{n}i", n, *(i % 2 for i in range(n))) for n in counts)


FACES = ("element face 3", "property list uchar int vertex_indices")


@pytest.mark.parametrize("counts", [[3, 3, 3], [3, 4, 3], [0, 0, 0], [0, 3, 255]])
@pytest.mark.parametrize("before", [False, True])
def test_faces_are_left_out(counts, before):
    vertex = ("element vertex 2", *XYZ)
    lines = (*FACES, *vertex) if before else (*vertex, *FACES)
    parts = [POINTS.tobytes(), faces(counts)]
    cloud = decode_ply(ply(*lines, body=b"".join(reversed(parts) if before else parts)))
    np.testing.assert_array_equal(cloud.xyz, POINTS)


@pytest.mark.parametrize("counts", [[2, 2], [0, 3], [0, 0]])
@pytest.mark.parametrize("order", ["<", ">"])
def test_list_before_x(counts, order):
    body = b"".join(
        struct.pack(f"{order}H{n}d", n, *range(n)) + point.astype(f"{order}f4").tobytes() + b"\x07"
        for n, point in zip(counts, POINTS, strict=True)
    )
    encoding = "binary_little_endian" if order == "<" else "binary_big_endian"
    lines = ("element vertex 2", "property list ushort double w", *XYZ, "property uchar c")
    cloud = decode_ply(ply(*lines, body=body, encoding=encoding))
    np.testing.assert_array_equal(cloud.xyz, POINTS)
    assert cloud.extra["c"].tolist() == [7, 7]


@pytest.mark.parametrize("bad", [2, -1, 999_999])
@pytest.mark.parametrize("counts", [[3, 3, 3], [3, 4, 3]], ids=["triangles", "mixed"])
@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
def test_faces_of_vertices_that_are_not_there(bad, counts, before, name):
    good = faces(counts)
    at = 1 + 4 * counts[0] + 1 + 4  # the second number of the second face
    body = good[:at] + struct.pack("<i", bad) + good[at + 4 :]
    vertex = ("element vertex 2", *XYZ)
    listed = ("element face 3", f"property list uchar int {name}")
    lines = (*listed, *vertex) if before else (*vertex, *listed)
    parts = (body, POINTS.tobytes()) if before else (POINTS.tobytes(), body)
    with pytest.raises(MeshIndex, match=rf"face 1.* 0 {bad} 0.*from 0 to 1"):
        decode_ply(ply(*lines, body=b"".join(parts)))


@pytest.mark.parametrize("bad", [b"2", b"-1", b"1.0", b"9999999999999999999", b"x"])
def test_faces_in_text_of_vertices_that_are_not_there(bad):
    lines = ("element vertex 2", *XYZ, *FACES)
    body = b"1.5 2 3\n-4 5.25 1e-3\n3 0 1 1\n4 0 1 1 " + bad + b"\n0\n"
    with pytest.raises(MeshIndex, match="face 1"):
        decode_ply(ply(*lines, body=body, encoding="ascii"))


def test_text_with_lists_and_faces():
    body = b"2 9 9 1.5 2 3\n0 -4 5.25 1e-3\n\n3 0 1 1\n4 0 1 1 0\n0\n"
    lines = ("element vertex 2", "property list uchar int w", *XYZ, *FACES)
    cloud = decode_ply(ply(*lines, body=body, encoding="ascii"))
    np.testing.assert_array_equal(cloud.xyz, POINTS)


def test_names_of_cloudcompare_and_meshlab():
    lines = ("property float scalar_Intensity", "property uchar red", "property uchar green")
    record = np.zeros(2, "<f4,<f4,<f4,<f4,u1,u1,u1,u1")
    record["f0"], record["f1"], record["f2"] = POINTS.T
    record["f3"], record["f4"], record["f7"] = (0.25, 1), 9, 200
    data = ply(
        "element vertex 2", *XYZ, *lines, "property uchar blue", "property uchar alpha",
        body=record.tobytes(),
    )  # fmt: skip
    cloud = decode_ply(data)
    assert cloud.intensity.tolist() == [0.25, 1]
    assert cloud.rgb.tolist() == [[9, 0, 0]] * 2
    assert cloud.extra["alpha"].tolist() == [200, 200]


def test_property_beside_one_of_its_short_name():
    lines = ("property uchar ring", "property uchar scalar_ring", "property uchar scalar_X")
    record = np.zeros(2, "<f4,<f4,<f4,u1,u1,u1")
    record["f0"], record["f3"], record["f4"] = POINTS[:, 0], 1, 2
    cloud = decode_ply(ply("element vertex 2", *XYZ, *lines, body=record.tobytes()))
    assert {name: column[0] for name, column in cloud.extra.items()} == {
        "ring": 1,
        "scalar_ring": 2,
        "X": 0,
    }
    np.testing.assert_array_equal(cloud.xyz[:, 0], POINTS[:, 0])


def test_holes_of_others_make_the_cloud_organised():
    holed = POINTS.copy()
    holed[1] = np.nan
    assert decode_ply(points_ply(holed.tobytes())).shape == (1, 2)


# --- refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (points_ply().replace(b"ply\n", b"plx\n"), 1),
        (points_ply().replace(b"1.0", b"2.0"), 2),
        (points_ply().replace(b"binary_little_endian", b"binary"), 2),
        (points_ply().replace(b"element vertex 2", b"element vertex -2"), 3),
        (points_ply().replace(b"element vertex 2", b"element vertex 2 2"), 3),
        (points_ply().replace(b"element vertex 2\n", b""), 3),
        (points_ply().replace(b"float y", b"half y"), 5),
        (points_ply().replace(b"float y", b"list float int y"), 5),
        (points_ply().replace(b"float y", b"list uchar y"), 5),
        (points_ply().replace(b"end_header", b"bogus"), 7),
    ],
)
def test_illegal_header_names_the_line(data, line):
    with pytest.raises(PointFileHeader) as error:
        decode_ply(data)
    assert error.value.where == f"line {line}"


def test_property_twice():
    with pytest.raises(PointFileHeader, match="'x' of 'vertex' twice"):
        decode_ply(points_ply().replace(b"float y", b"float x"))


@pytest.mark.parametrize(
    "lines",
    [
        ("element face 0", "property list uchar int vertex_indices"),
        ("element vertex 0",),
        ("element vertex 2", "property list uchar float x"),
        ("element vertex 0", *XYZ, "element vertex 0", *XYZ),
        ("element vertex 0", *XYZ[:2]),
    ],
)
def test_no_xyz(lines):
    with pytest.raises(PointFileField):
        decode_ply(ply(*lines, body=bytes(2) if "2" in lines[0] else b""))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("count", [2 * 10**8, 10**12, 10**17])
@pytest.mark.parametrize("element", ["vertex", "face"])
def test_claims_are_checked_before_allocation(encoding, count, element):
    lines = ["element vertex 2", *XYZ, *FACES]
    at = 0 if element == "vertex" else 4
    lines[at] = f"element {element} {count}"
    with pytest.raises(PointFileTruncated):
        decode_ply(ply(*lines, body=b"1 2 3\n" * 100, encoding=encoding))


def test_long_list_is_not_believed():
    lines = ("element vertex 2", *XYZ, "element face 2", "property list uint double w")
    body = POINTS.tobytes() + struct.pack("<I", 2**32 - 1) + bytes(4)
    with pytest.raises(PointFileTruncated):
        decode_ply(ply(*lines, body=body))


def test_negative_list():
    lines = ("element vertex 2", *XYZ, "element face 1", "property list char int w")
    with pytest.raises(PointFileCorrupt, match="list of -1"):
        decode_ply(ply(*lines, body=POINTS.tobytes() + b"\xff"))


@pytest.mark.parametrize("word", [b"x", b"-1", b"2", b"9" * 5000, b"3.0"])
def test_faces_in_text_that_do_not_fit(word):
    lines = ("element vertex 2", *XYZ, *FACES)
    body = b"1 2 3\n4 5 6\n3 0 1 1\n" + word + b" 0 1 1\n3 0 1 1\n"
    with pytest.raises(PointFileCorrupt, match="line 2 of 'face'"):
        decode_ply(ply(*lines, body=body, encoding="ascii"))


def test_limit_of_points():
    with pytest.raises(LimitError):
        decode_ply(points_ply(), limits=Limits(points=1))


@pytest.mark.parametrize("more", [b"\n", bytes(12)])
def test_bytes_behind_the_points_are_refused(more):
    with pytest.raises(PointFileCorrupt, match="behind the last"):
        decode_ply(points_ply() + more)
    with pytest.raises(PointFileCorrupt, match="3 lines of items"):
        decode_ply(points_ply(b"1 2 3\n4 5 6\n7 8 9\n", encoding="ascii"))


def test_other_content_under_the_name(tmp_path, make_cloud):
    path = tmp_path / "cloud.ply"
    path.write_bytes(encode_pcd(make_cloud(3)))
    with pytest.raises(PointFileHeader, match="PCD") as error:
        read_ply(path)
    assert "PLY" in error.value.want
