from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import (
    LimitError,
    PointFileCorrupt,
    PointFileHeader,
    PointFileMissing,
    PointFileTruncated,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.points.velodyne_txt import encode_velodyne_txt, read_velodyne_txt
from pseudolidar.structures.frame import LidarScan


def test_a_scan_comes_back_as_it_was(tmp_path):
    rng = np.random.default_rng(0)
    scan = LidarScan(
        rng.normal(0, 30, (500, 3)).astype(np.float32), rng.random(500).astype(np.float32)
    )
    path = tmp_path / "0.txt"
    path.write_bytes(encode_velodyne_txt(scan))
    back = read_velodyne_txt(path, timestamp_ns=5)
    np.testing.assert_array_equal(back.xyz, scan.xyz)
    np.testing.assert_array_equal(back.reflectance, scan.reflectance)
    assert (back.timestamp_ns, back.frame, back.dropped) == (5, "velodyne", 0)


@pytest.mark.parametrize(
    ("text", "points"), [(b"", 0), (b"\n1 2 3 0.5\r\n\n", 1), (b"1 2 3 .5\n4 5 6 1e-1\n", 2)]
)
def test_what_is_a_scan(tmp_path, text, points):
    (tmp_path / "0.txt").write_bytes(text)
    assert len(read_velodyne_txt(tmp_path / "0.txt")) == points


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (b"1 2 3 4", PointFileTruncated),
        (b"1.00 2.00 3.00 4.00\n1 2 3\n", PointFileCorrupt),
        (b"1 2 3 x\n", PointFileCorrupt),
        (b"nan nan nan 1\n1 2 3 4\n", PointFileCorrupt),
        (b"\x89PNG\r\n\x1a\n\0\0", PointFileHeader),
        ("\uff11 2 3 4\n".encode(), PointFileCorrupt),
    ],
)
def test_what_is_none_is_refused(tmp_path, text, error):
    path = tmp_path / "0.txt"
    path.write_bytes(text)
    with pytest.raises(error) as caught:
        read_velodyne_txt(path)
    assert caught.value.path == str(path)


def test_caps_and_absence(tmp_path):
    (tmp_path / "0.txt").write_bytes(b"1 2 3 4\n" * 20)
    with pytest.raises(LimitError):
        read_velodyne_txt(tmp_path / "0.txt", limits=Limits(points=10))
    with pytest.raises(PointFileMissing):
        read_velodyne_txt(tmp_path / "absent.txt")


def test_a_few_impossible_points_are_left_out(tmp_path):
    (tmp_path / "0.txt").write_bytes(b"1 2 3 0.4\n" * 19 + b"1e9 2 3 0.4\n")
    scan = read_velodyne_txt(tmp_path / "0.txt")
    assert (len(scan), scan.dropped) == (19, 1)
