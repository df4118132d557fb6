"""Every column survives every format that has columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import OutputError, PointFileMissing, StructureError
from pseudolidar.formats.points.npz import decode_npz, encode_npz, read_npz, write_npz
from pseudolidar.formats.points.pcd import (
    decode_pcd,
    encode_pcd,
    encode_pcd_pieces,
    read_pcd,
    write_pcd,
)
from pseudolidar.formats.points.ply import (
    decode_ply,
    encode_ply,
    encode_ply_pieces,
    read_ply,
    write_ply,
)

FORMATS = {
    "pcd-binary": (encode_pcd, decode_pcd, "binary"),
    "pcd-compressed": (encode_pcd, decode_pcd, "binary_compressed"),
    "pcd-ascii": (encode_pcd, decode_pcd, "ascii"),
    "ply-binary": (encode_ply, decode_ply, "binary_little_endian"),
    "ply-ascii": (encode_ply, decode_ply, "ascii"),
    "npz": (encode_npz, decode_npz, None),
}


@pytest.fixture(params=FORMATS)
def codec(request):
    encode, decode, encoding = FORMATS[request.param]
    options = {} if encoding is None else {"encoding": encoding}
    return lambda cloud: encode(cloud, **options), decode


@pytest.mark.parametrize("n", [0, 1, 60])
@pytest.mark.parametrize("wide", [False, True])
def test_every_column_survives(codec, make_cloud, assert_same_cloud, n, wide):
    encode, decode = codec
    cloud = make_cloud(n, wide=wide)
    assert_same_cloud(decode(encode(cloud)), cloud)


@pytest.mark.parametrize("shape", [(6, 10), (1, 60), (60, 1)])
def test_organised_cloud_keeps_shape_and_holes(codec, make_cloud, assert_same_cloud, shape):
    encode, decode = codec
    cloud = make_cloud(60, shape=shape)
    assert np.isnan(cloud.xyz).any()
    assert_same_cloud(decode(encode(cloud)), cloud)


@pytest.mark.parametrize("column", ["rgb", "intensity", "sigma_m", "uv"])
def test_absent_column_stays_absent(codec, make_cloud, assert_same_cloud, column):
    encode, decode = codec
    cloud = replace(make_cloud(), **{column: None})
    assert_same_cloud(decode(encode(cloud)), cloud)


@pytest.mark.parametrize(
    ("encode", "encode_pieces"), [(encode_pcd, encode_pcd_pieces), (encode_ply, encode_ply_pieces)]
)
def test_pieces_are_the_bytes_of_the_whole(make_cloud, encode, encode_pieces):
    cloud = make_cloud(60)
    pieces = [cloud[:1], cloud[1:40], cloud[40:]]
    assert b"".join(encode_pieces(iter(pieces), 60)) == encode(cloud)


def test_points_alone(codec, make_cloud, assert_same_cloud, without_columns):
    encode, decode = codec
    cloud = without_columns(make_cloud())
    assert_same_cloud(decode(encode(cloud)), cloud)


@pytest.mark.parametrize("frame", ["map", "Fahrt 7 / Kamera ü", 'a "quoted"\nline', "\ud800"])
def test_frame_and_time_survive_any_text(codec, make_cloud, frame):
    encode, decode = codec
    cloud = replace(make_cloud(3), frame=frame, timestamp_ns=-(2**63) + 1)
    read = decode(encode(cloud))
    assert (read.frame, read.timestamp_ns) == (frame, cloud.timestamp_ns)


def test_extra_column_may_have_the_name_of_an_absent_one(codec, make_cloud, assert_same_cloud):
    encode, decode = codec
    strange = {"intensity": np.arange(60, dtype=np.float32), "u": np.arange(60.0)}
    cloud = replace(make_cloud(), intensity=None, uv=None, extra=strange)
    assert_same_cloud(decode(encode(cloud)), cloud)


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("x", np.zeros(5)),
        ("rgb", np.zeros(5)),
        ("sigma_m", np.zeros(5)),
        ("two words", np.zeros(5)),
        ("a#b", np.zeros(5)),
        ("", np.zeros(5)),
        ("pairs", np.zeros((5, 2))),
        ("text", np.array(list("abcde"))),
        ("objects", np.array([None] * 5)),
    ],
)
def test_extra_column_that_no_field_can_hold_is_refused(codec, make_cloud, name, column):
    encode, _ = codec
    with pytest.raises(StructureError) as error:
        encode(replace(make_cloud(5), extra={name: column}))
    assert error.value.where == f"PointCloud.extra[{name!r}]"


def test_same_cloud_gives_same_bytes(codec, make_cloud):
    encode, _ = codec
    assert encode(make_cloud()) == encode(make_cloud())


def test_columns_of_any_memory_layout(codec, make_cloud, assert_same_cloud):
    encode, decode = codec
    cloud = make_cloud(60)
    turned = replace(
        cloud,
        xyz=np.asfortranarray(cloud.xyz),
        rgb=cloud.rgb[:, ::-1].copy()[:, ::-1],
        extra={"big": np.arange(60, dtype=">i4"), "step": np.arange(120)[::2]},
    )
    read = decode(encode(turned))
    np.testing.assert_array_equal(read.xyz, cloud.xyz)
    np.testing.assert_array_equal(read.rgb, cloud.rgb)
    np.testing.assert_array_equal(read.extra["big"], np.arange(60))
    np.testing.assert_array_equal(read.extra["step"], np.arange(120)[::2])


@pytest.mark.parametrize(
    ("write", "read", "name"),
    [
        (write_pcd, read_pcd, "a.pcd"),
        (write_ply, read_ply, "a.ply"),
        (write_npz, read_npz, "a.npz"),
    ],
)
def test_files(tmp_path, make_cloud, assert_same_cloud, write, read, name):
    path = tmp_path / "folder" / name
    write(path, make_cloud())
    assert_same_cloud(read(path), make_cloud())
    assert [p.name for p in path.parent.iterdir()] == [name]
    with pytest.raises(PointFileMissing) as error:
        read(tmp_path / "absent" / name)
    assert error.value.path == str(tmp_path / "absent" / name)
    with pytest.raises(PointFileMissing):
        read(tmp_path)
    with pytest.raises(OutputError):
        write(path / "below a file.pcd", make_cloud())
