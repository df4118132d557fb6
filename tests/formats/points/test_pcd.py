from __future__ import annotations

import struct

import numpy as np
import pytest

from pseudolidar.errors import (
    LimitError,
    PointFileCorrupt,
    PointFileField,
    PointFileHeader,
    PointFileTruncated,
    PseudolidarError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.points.pcd import decode_pcd, encode_pcd, read_pcd
from pseudolidar.formats.points.ply import encode_ply

HEADER = {
    "VERSION": "0.7",
    "FIELDS": "x y z",
    "SIZE": "4 4 4",
    "TYPE": "F F F",
    "COUNT": "1 1 1",
    "WIDTH": "2",
    "HEIGHT": "1",
    "VIEWPOINT": "0 0 0 1 0 0 0",
    "POINTS": "2",
    "DATA": "binary",
}
POINTS = np.array([[1.5, 2, 3], [-4, 5.25, 1e-3]], np.float32)


def pcd(body: bytes, *, end: str = "\n", **changed: str | None) -> bytes:
    """A PCD of others: `HEADER` with some lines changed (None = left out)."""
    lines = {**HEADER, **changed}
    text = "".join(f"{key} {value}{end}" for key, value in lines.items() if value is not None)
    return text.encode() + body


def test_header_of_a_written_file(make_cloud, without_columns):
    lines = encode_pcd(without_columns(make_cloud(60, shape=(6, 10)))).split(b"\n")[:15]
    assert lines[0] == b"# .PCD v0.7 - Point Cloud Data file format"
    assert b'# pseudolidar frame "camera_left"' in lines
    assert b"# pseudolidar timestamp_ns 1317384506123456789" in lines
    assert lines[5:15] == [
        b"VERSION 0.7",
        b"FIELDS x y z",
        b"SIZE 4 4 4",
        b"TYPE F F F",
        b"COUNT 1 1 1",
        b"WIDTH 10",
        b"HEIGHT 6",
        b"VIEWPOINT 0 0 0 1 0 0 0",
        b"POINTS 60",
        b"DATA binary",
    ]


def test_colour_bits_are_those_of_pcl(make_cloud):
    cloud = make_cloud(1)
    header, body = encode_pcd(cloud).split(b"DATA binary\n")
    assert b"TYPE F F F F" in header
    r, g, b = (int(v) for v in cloud.rgb[0])
    assert struct.unpack_from("<I", body, 12)[0] == r << 16 | g << 8 | b
    header, body = encode_pcd(cloud, encoding="ascii").split(b"DATA ascii\n")
    assert b"TYPE F F F U" in header
    assert int(body.split()[3]) == r << 16 | g << 8 | b


# --- files of others -----------------------------------------------------------------------


def test_plain_file_of_others():
    cloud = decode_pcd(pcd(POINTS.tobytes()))
    np.testing.assert_array_equal(cloud.xyz, POINTS)
    assert (cloud.frame, cloud.timestamp_ns, cloud.shape) == ("unknown", 0, None)
    assert cloud.xyz.dtype == np.float32


@pytest.mark.parametrize(
    "changed",
    [
        {"VERSION": ".7"},
        {"VERSION": None},
        {"COUNT": None},
        {"VIEWPOINT": None},
        {"POINTS": None},
        {"TYPE": "f F f"},
        {"DATA": "BINARY"},
        {"FIELDS": "X y Z"},
    ],
)
def test_header_variants(changed):
    np.testing.assert_array_equal(decode_pcd(pcd(POINTS.tobytes(), **changed)).xyz, POINTS)


def test_crlf_bom_blank_lines_lower_case_and_columns_keyword():
    data = pcd(POINTS.tobytes(), end="\r\n")
    np.testing.assert_array_equal(decode_pcd(data).xyz, POINTS)
    data = b"\xef\xbb\xbf# caf\xe9\r\n\r\n" + data
    np.testing.assert_array_equal(decode_pcd(data).xyz, POINTS)
    head, body = data[:-24], data[-24:]
    lower = head.replace(b"FIELDS", b"columns").replace(b"WIDTH", b"width")
    np.testing.assert_array_equal(decode_pcd(lower + body).xyz, POINTS)


def test_crlf_text():
    body = b"1.5 2 3\r\n-4 5.25 1e-3\r\n"
    np.testing.assert_array_equal(decode_pcd(pcd(body, end="\r\n", DATA="ascii")).xyz, POINTS)


def test_text_with_tabs_blank_lines_and_nan():
    cloud = decode_pcd(pcd(b"\n1.5\t2  3 \n\n nan nan NaN\n  \n", DATA="ascii"))
    np.testing.assert_array_equal(cloud.xyz, [[1.5, 2, 3], [np.nan] * 3])
    assert cloud.shape == (1, 2)  # a hole is only legal in an organised cloud


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_padding_counts_and_mixed_types(encoding):
    """Padding `_` (twice, COUNT 3), a descriptor of COUNT 2, int8, uint16 and double."""
    kinds = [("x", "F", 8, 1), ("_", "U", 1, 3), ("y", "f", 8, 1), ("z", "F", 8, 1)]
    kinds += [("fpfh", "F", 4, 2), ("_", "U", 1, 1), ("ring", "u", 2, 1), ("class", "I", 1, 1)]
    record = np.dtype([(str(i), f"<{k[1].lower()}{k[2]}", (k[3],)) for i, k in enumerate(kinds)])
    rng = np.random.default_rng(1)
    values = np.zeros(5, record)
    for name in record.names:
        kind = record[name].base.kind
        shape = values[name].shape
        values[name] = rng.normal(size=shape) if kind == "f" else rng.integers(0, 100, shape)
    values["7"] -= 50
    if encoding == "binary":
        body = values.tobytes()
    elif encoding == "ascii":
        rows = [[repr(v.item()) for part in row for v in part] for row in values]
        body = "".join(" ".join(row) + "\n" for row in rows).encode()
    else:
        plain = b"".join(values[name].tobytes() for name in record.names)
        # A literal run of LZF holds up to 32 bytes: no compressor is needed.
        runs = [plain[i : i + 32] for i in range(0, len(plain), 32)]
        packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
        body = struct.pack("<II", len(packed), len(plain)) + packed
    joined = (" ".join(str(k[i]) for k in kinds) for i in range(4))
    names, types, sizes, counts = joined
    changed = {"FIELDS": names, "TYPE": types, "SIZE": sizes, "COUNT": counts}
    cloud = decode_pcd(pcd(body, WIDTH="5", POINTS="5", DATA=encoding, **changed))
    assert cloud.xyz.dtype == np.float64
    for axis, name in enumerate("023"):
        np.testing.assert_array_equal(cloud.xyz[:, axis], values[name][:, 0])
    assert list(cloud.extra) == ["fpfh_0", "fpfh_1", "ring", "class"]
    np.testing.assert_array_equal(cloud.extra["fpfh_1"], values["4"][:, 1])
    np.testing.assert_array_equal(cloud.extra["ring"], values["6"][:, 0])
    np.testing.assert_array_equal(cloud.extra["class"], values["7"][:, 0])
    assert [cloud.extra[n].dtype.name for n in ("ring", "class")] == ["uint16", "int8"]


@pytest.mark.parametrize("kind", ["F", "U", "I"])
@pytest.mark.parametrize("name", ["rgb", "rgba", "RGB"])
def test_packed_colours_of_others(kind, name):
    bits = struct.pack("<I", 200 << 24 | 17 << 16 | 34 << 8 | 51)
    body = b"".join(point.tobytes() + bits for point in POINTS)
    changed = {"FIELDS": f"x y z {name}", "SIZE": "4 4 4 4", "TYPE": f"F F F {kind}"}
    cloud = decode_pcd(pcd(body, COUNT="1 1 1 1", **changed))
    np.testing.assert_array_equal(cloud.rgb, [[17, 34, 51]] * 2)
    assert {n: c.tolist() for n, c in cloud.extra.items()} == (
        {"alpha": [200, 200]} if name == "rgba" else {}
    )


def test_float_colours_in_text_keep_their_bits():
    bits = 17 << 16 | 34 << 8 | 51
    number = float(np.uint32(bits).view(np.float32))
    body = f"1 2 3 {number:.9g}\n4 5 6 {number:.9g}\n".encode()
    changed = {"FIELDS": "x y z rgb", "SIZE": "4 4 4 4", "TYPE": "F F F F", "COUNT": "1 1 1 1"}
    cloud = decode_pcd(pcd(body, DATA="ascii", **changed))
    np.testing.assert_array_equal(cloud.rgb, [[17, 34, 51]] * 2)


@pytest.mark.parametrize(
    ("values", "is_intensity"), [([0.0, 1.0], True), ([0.5, np.nan], True), ([3.0, 255.0], False)]
)
def test_intensity_of_others_only_if_0_to_1(values, is_intensity):
    body = np.column_stack([POINTS, values]).astype("<f4").tobytes()
    changed = {"FIELDS": "x y z intensity", "SIZE": "4 4 4 4", "TYPE": "F F F F"}
    cloud = decode_pcd(pcd(body, COUNT="1 1 1 1", **changed))
    found = cloud.intensity if is_intensity else cloud.extra["intensity"]
    np.testing.assert_array_equal(found, np.float32(values))
    assert (cloud.intensity is None) is not is_intensity


def test_organised_file_of_others():
    cloud = decode_pcd(pcd(POINTS.tobytes(), WIDTH="1", HEIGHT="2"))
    assert cloud.shape == (2, 1)


# --- refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "line", "legal"),
    [
        ({"VERSION": "2"}, 1, "0.7"),
        ({"SIZE": "4 4 3"}, 3, "4 or 8"),
        ({"SIZE": "2 2 2"}, 3, "4 or 8"),
        ({"SIZE": "4 4 -4"}, 3, "whole number"),
        ({"SIZE": "4 4"}, 3, "3, one for each"),
        ({"TYPE": "F F X"}, 4, "F, I or U"),
        ({"TYPE": "F F F F"}, 4, "3, one for each"),
        ({"COUNT": "1 1 0"}, 5, "1 or more"),
        ({"COUNT": "1 1 1e1"}, 5, "whole number"),
        ({"COUNT": "1 1 99999999"}, 5, "at most 10000"),
        ({"WIDTH": "-2"}, 6, "whole number"),
        ({"WIDTH": "\u0662"}, 6, "whole number"),
        ({"WIDTH": "1_0"}, 6, "whole number"),
        ({"POINTS": "3"}, 9, "2 x 1 = 2"),
        ({"POINTS": "two"}, 9, "whole number"),
        ({"DATA": "bogus"}, 10, "ascii or binary or binary_compressed"),
        ({"FIELDS": "x y y"}, 2, "different names"),
        ({"VERSION": "0.7\nBOGUS 1"}, 2, "one each of"),
        ({"WIDTH": "2\nWIDTH 2"}, 7, "one each of"),
    ],
)
def test_illegal_header_names_line_and_legal_values(changed, line, legal):
    with pytest.raises(PointFileHeader) as error:
        decode_pcd(pcd(POINTS.tobytes(), **changed))
    assert error.value.where == f"line {line}"
    assert legal in error.value.want


@pytest.mark.parametrize("missing", ["FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT"])
def test_missing_line_is_named(missing):
    with pytest.raises(PointFileHeader, match=f"no {missing} line"):
        decode_pcd(pcd(POINTS.tobytes(), **{missing: None}))


def test_no_xyz_names_the_fields():
    with pytest.raises(PointFileField, match="fields x, y, range"):
        decode_pcd(pcd(POINTS.tobytes(), FIELDS="x y range"))


def test_other_content_under_the_name(tmp_path, make_cloud):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(encode_ply(make_cloud(3)))
    with pytest.raises(PointFileHeader, match="PLY") as error:
        read_pcd(path)
    assert "PCD" in error.value.want
    assert error.value.path == str(path)


@pytest.mark.parametrize("points", [10**8, 2 * 10**8, 10**12, 10**17])
@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_claims_are_checked_before_allocation(points, encoding):
    body = struct.pack("<II", 16, points * 12 % 2**32) + bytes(16)
    data = pcd(body, WIDTH=str(points), POINTS=str(points), DATA=encoding)
    with pytest.raises(PointFileTruncated, match=f"of {points}"):
        decode_pcd(data)


def test_limit_of_points():
    with pytest.raises(LimitError):
        decode_pcd(pcd(POINTS.tobytes()), limits=Limits(points=1))


def test_bytes_behind_the_points_are_refused():
    with pytest.raises(PointFileCorrupt, match="1 bytes behind"):
        decode_pcd(pcd(POINTS.tobytes() + b"\n"))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"1.00 2 3\n4 5\n", "2 values"),
        (b"1 2 3\n4 5 6 7\n", "4 values"),
        (b"1 2 3 4\n5 6\n", "4 values"),
        (b"1 2 3\n4 5 abc\n", "character"),
        (b"1 2 3\n4 5 1_0\n", "character '_'"),
        (b"1 2 3\n4 5 0x1\n", "character 'x'"),
        (b"1 2 3\n4 5 1.2.3\n", "a word"),
        (b"1 2 3\n4 5 6\n7 8 9\n", "3 lines"),
    ],
)
def test_text_that_is_no_table(body, message):
    with pytest.raises(PointFileCorrupt, match=message):
        decode_pcd(pcd(body, DATA="ascii"))


@pytest.mark.parametrize("word", ["256", "-1", "1.5", "nan", "inf"])
def test_text_that_does_not_fit_the_type(word):
    changed = {"FIELDS": "x y z c", "SIZE": "4 4 4 1", "TYPE": "F F F U", "COUNT": "1 1 1 1"}
    body = f"1 2 3 4\n1 2 3 {word}\n".encode()
    with pytest.raises(PointFileCorrupt, match="column 4"):
        decode_pcd(pcd(body, DATA="ascii", **changed))


@pytest.mark.parametrize("change", [-1, 1, 100])
@pytest.mark.parametrize("which", [0, 4])
def test_compressed_sizes_that_lie(make_cloud, change, which):
    data = bytearray(encode_pcd(make_cloud(), encoding="binary_compressed"))
    at = data.index(b"compressed\n") + len(b"compressed\n") + which
    (size,) = struct.unpack_from("<I", data, at)
    struct.pack_into("<I", data, at, size + change)
    with pytest.raises((PointFileCorrupt, PointFileTruncated)):
        decode_pcd(bytes(data))


def test_compressed_garbage_names_the_byte(make_cloud):
    data = bytearray(encode_pcd(make_cloud(), encoding="binary_compressed"))
    at = data.index(b"compressed\n") + len(b"compressed\n") + 8
    data[at : at + 2] = b"\xff\xff"  # a copy from before the beginning
    with pytest.raises(PointFileCorrupt) as error:
        decode_pcd(bytes(data))
    assert error.value.where == "compressed byte 0"


def test_error_is_a_sentence(tmp_path):
    path = tmp_path / "cut.pcd"
    path.write_bytes(pcd(POINTS.tobytes())[:-1])
    with pytest.raises(PseudolidarError) as error:
        read_pcd(path)
    assert str(error.value).startswith(f"PointFileTruncated: {path}: byte ")
    assert "enough for 1 of 2" in str(error.value)
