"""Files cut anywhere and mutated: a typed error or the whole cloud, never another one."""

from __future__ import annotations

import contextlib
import tracemalloc
import warnings
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import PointFileTruncated, PseudolidarError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.pfm import decode_pfm, encode_pfm
from pseudolidar.formats.points.npz import decode_npz, encode_npz
from pseudolidar.formats.points.pcd import decode_pcd, encode_pcd
from pseudolidar.formats.points.ply import decode_ply, encode_ply
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap

# A mutated header may claim what the file could hold; the test must not then wait for it.
LIMITS = Limits(points=100_000, pixels=100_000)
FACES = b"element face 2\nproperty list uchar int vertex_indices\nend_header\n"
MESH = (b"\x03" + bytes(12)) + (b"\x04" + bytes(16))


def with_faces(data: bytes) -> bytes:
    return data.replace(b"end_header\n", FACES) + MESH


def with_text_faces(data: bytes) -> bytes:
    return data.replace(b"end_header\n", FACES) + b"3 0 1 2\n4 0 1 2 3\n"


def pfm(cloud) -> bytes:
    values = np.random.default_rng(3).random((11, 13), np.float32)
    return encode_pfm(DisparityMap(values))


FILES = {
    "pcd-binary": (encode_pcd, decode_pcd),
    "pcd-compressed": (lambda c: encode_pcd(c, encoding="binary_compressed"), decode_pcd),
    "pcd-ascii": (lambda c: encode_pcd(c, encoding="ascii"), decode_pcd),
    "ply-binary": (encode_ply, decode_ply),
    "ply-ascii": (lambda c: encode_ply(c, encoding="ascii"), decode_ply),
    "ply-faces": (lambda c: with_faces(encode_ply(c)), decode_ply),
    "ply-ascii-faces": (lambda c: with_text_faces(encode_ply(c, encoding="ascii")), decode_ply),
    "npz": (encode_npz, decode_npz),
    "pfm": (pfm, decode_pfm),
}


@pytest.fixture(params=FILES)
def damaged(request, make_cloud):
    encode, decode = FILES[request.param]
    cloud = make_cloud(9)
    small = {name: cloud.extra[name] for name in ("of_int64", "of_bool")}
    return encode(replace(cloud, extra=small)), lambda data: decode(data, limits=LIMITS)


def test_cut_at_every_byte(damaged):
    data, decode = damaged
    decode(data)
    for size in range(len(data)):
        with pytest.raises(PseudolidarError) as error:
            decode(data[:size])
        assert error.value.code in ("PointFileTruncated", "ImageTruncated"), (size, error.value)


def mutations(data: bytes, count: int):
    """Seeded: flipped bits, other bytes, cut out and doubled parts, numbers made large."""
    rng = np.random.default_rng(11)
    header = max(40, len(data) - int(np.argmax(np.frombuffer(data[::-1], np.uint8) == 10)))
    for kind in rng.integers(0, 5, count):
        # Half of them in the first part, where the header is.
        limit = len(data) if rng.random() < 0.5 else min(header, 400, len(data))
        at = int(rng.integers(0, limit))
        other = bytearray(data)
        if kind == 0:
            other[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            other[at : at + 4] = rng.integers(0, 256, 4, np.uint8).tobytes()
        elif kind == 2:
            del other[at : at + int(rng.integers(1, 30))]
        elif kind == 3:
            other[at:at] = other[at : at + int(rng.integers(1, 30))]
        else:
            digits = [i for i, c in enumerate(data[:400]) if 48 <= c <= 57]
            at = digits[int(rng.integers(0, len(digits)))] if digits else at
            other[at : at + 1] = str(rng.integers(0, 10 ** int(rng.integers(1, 18)))).encode()
        yield bytes(other)


def test_mutations_give_typed_errors_only(damaged):
    data, decode = damaged
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for other in mutations(data, 400):
            with contextlib.suppress(PseudolidarError):
                decode(other)


def test_lying_headers_do_not_allocate(damaged):
    data, decode = damaged
    tracemalloc.start()
    try:
        for other in mutations(data, 200):
            with contextlib.suppress(PseudolidarError):
                decode(other)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20e6


@pytest.mark.real
@pytest.mark.parametrize("name", ["pcd-binary", "pcd-compressed", "ply-binary", "npz"])
def test_real_cloud_cut_in_header_and_body(real_data, name):
    scan = read_velodyne_bin(real_data / "kitti_stereo2015/training/velodyne/000002_10.bin")
    cloud = PointCloud(scan.xyz, scan.frame, intensity=scan.reflectance)
    encode, decode = FILES[name]
    data = encode(cloud)
    np.testing.assert_array_equal(decode(data).xyz, scan.xyz)
    body = np.random.default_rng(1).integers(600, len(data), 40)
    for size in (*range(600), *body, len(data) - 1):
        with pytest.raises(PointFileTruncated):
            decode(data[:size])
