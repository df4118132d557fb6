from __future__ import annotations

import io
import struct
import zipfile

import numpy as np
import pytest

from pseudolidar.errors import (
    LimitError,
    PointFileCorrupt,
    PointFileField,
    PointFileHeader,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.points.npz import decode_npz, encode_npz
from pseudolidar.structures.cloud import PointCloud


def saved(save=np.savez, **arrays) -> bytes:
    buffer = io.BytesIO()
    save(buffer, **arrays)
    return buffer.getvalue()


def test_numpy_reads_it_without_pickle(make_cloud):
    cloud = make_cloud(60, shape=(6, 10))
    with np.load(io.BytesIO(encode_npz(cloud)), allow_pickle=False) as arrays:
        for name in ("xyz", "rgb", "intensity", "sigma_m", "uv"):
            np.testing.assert_array_equal(arrays[name], getattr(cloud, name))
        for name, column in cloud.extra.items():
            assert arrays[name].dtype == column.dtype
        assert str(arrays["frame"]) == cloud.frame
        assert int(arrays["timestamp_ns"]) == cloud.timestamp_ns
        assert tuple(arrays["shape"]) == cloud.shape


def test_no_member_has_a_time(make_cloud):
    with zipfile.ZipFile(io.BytesIO(encode_npz(make_cloud(3)))) as archive:
        assert {member.date_time for member in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_archive_of_others(save):
    xyz = np.random.default_rng(1).random((50, 3))
    cloud = decode_npz(saved(save, xyz=xyz, label=np.arange(50, dtype=">i4")))
    np.testing.assert_array_equal(cloud.xyz, xyz)
    np.testing.assert_array_equal(cloud.extra["label"], np.arange(50))
    assert (cloud.frame, cloud.timestamp_ns, cloud.shape) == ("unknown", 0, None)


def test_names_that_no_format_can_hold():
    columns = {"laser id": np.arange(5), "laser#id": np.ones(5), "größe": np.zeros(5, np.int8)}
    cloud = decode_npz(saved(xyz=np.zeros((5, 3)), **columns))
    assert list(cloud.extra) == ["laser_id", "laser_id_", "gr__e"]
    assert list(decode_npz(encode_npz(cloud)).extra) == list(cloud.extra)


@pytest.mark.parametrize(
    "arrays",
    [
        {"xyz": np.zeros((5, 3)), "boxed": np.array([None] * 5, object)},
        {"xyz": np.array([None] * 5, object)},
        {"xyz": np.zeros((5, 3), int)},
        {"xyz": np.zeros((5, 4))},
        {"xyz": np.zeros((5, 3)), "rgb": np.zeros((5, 3))},
        {"xyz": np.zeros((5, 3)), "short": np.zeros(4)},
        {"xyz": np.zeros((5, 3)), "wide": np.zeros((5, 2))},
        {"xyz": np.zeros((5, 3)), "scalar": np.zeros(())},
        {"xyz": np.zeros((5, 3)), "shape": np.array([2, 3])},
        {"xyz": np.zeros((5, 3)), "shape": np.array(5)},
        {"xyz": np.zeros((5, 3)), "frame": np.array([1, 2])},
        {"xyz": np.zeros((5, 3)), "timestamp_ns": np.array(["soon"])},
        {"xyz": np.zeros((5, 3)), "columns": np.array([1])},
        {"xyz": np.asfortranarray(np.zeros((5, 3)))},
    ],
)
def test_wrong_arrays_are_refused(arrays):
    with pytest.raises(PointFileCorrupt):
        decode_npz(saved(**arrays))


def test_pickle_is_never_loaded(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "sprung"), "w"))

    data = saved(xyz=np.zeros((1, 3)), trap=np.array([Trap()], object))
    with pytest.raises(PointFileCorrupt):
        decode_npz(data)
    assert not (tmp_path / "sprung").exists()


def test_no_xyz_names_the_arrays():
    with pytest.raises(PointFileField, match="arrays points, label"):
        decode_npz(saved(points=np.zeros((5, 3)), label=np.zeros(5)))


def test_other_content():
    with pytest.raises(PointFileHeader, match="PLY"):
        decode_npz(b"ply\nformat ascii 1.0\n")


def test_bomb_is_refused_before_it_expands():
    data = saved(np.savez_compressed, xyz=np.zeros((4_000_000, 3), np.float32))
    assert len(data) < 100_000
    with pytest.raises(LimitError):
        decode_npz(data)
    with pytest.raises(LimitError):
        decode_npz(saved(xyz=np.zeros((9, 3))), limits=Limits(points=8))


def member(text: str, body: bytes = b"") -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        header = text.encode() + b"\n"
        magic = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header))
        archive.writestr("xyz.npy", magic + header + body)
    return buffer.getvalue()


@pytest.mark.parametrize(
    "text",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 3)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, -3)}",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1, 3)}",
        "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3, 3)}",
        "{'descr': 'nonsense', 'fortran_order': False, 'shape': (1, 3)}",
        "{'shape': (1, 3)}",
        "(" * 3000,
        "'" * 7,
        "__import__('os').getcwd()",
    ],
)
def test_array_headers_that_lie(text):
    with pytest.raises(PseudolidarError):
        decode_npz(member(text, bytes(12)))


def test_extra_column_with_the_name_of_a_fact():
    cloud = PointCloud(np.zeros((2, 3)), "map", extra={"frame": np.zeros(2)})
    with pytest.raises(StructureError, match="'frame'"):
        encode_npz(cloud)
