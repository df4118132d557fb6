from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import (
    LimitError,
    PointFileCorrupt,
    PointFileMissing,
    PointFileTruncated,
    StructureError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.points.velodyne_bin import (
    encode_velodyne_bin,
    read_velodyne_bin,
    write_velodyne_bin,
)
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan


@pytest.fixture
def scan(tmp_path):
    """A file of 100 points and its values (100, 4)."""
    rng = np.random.default_rng(5)
    values = (rng.random((100, 4)) * [80, 40, 4, 1] - [40, 20, 2, 0]).astype("<f4")
    path = tmp_path / "000000.bin"
    path.write_bytes(values.tobytes())
    return path, values


def test_read(scan):
    path, values = scan
    read = read_velodyne_bin(path, timestamp_ns=7)
    np.testing.assert_array_equal(read.xyz, values[:, :3])
    np.testing.assert_array_equal(read.reflectance, values[:, 3])
    assert (read.timestamp_ns, read.frame, read.dropped) == (7, "velodyne", 0)


def test_scan_round_trip_keeps_the_bytes(scan, tmp_path):
    path, _ = scan
    write_velodyne_bin(tmp_path / "copy.bin", read_velodyne_bin(path))
    assert (tmp_path / "copy.bin").read_bytes() == path.read_bytes()


@pytest.mark.real
def test_real_scans_keep_their_bytes(real_data):
    for path in sorted((real_data / "kitti_stereo2015/training/velodyne").glob("*.bin"))[:2]:
        read = read_velodyne_bin(path)
        assert len(read) > 100_000
        assert read.dropped == 0
        assert encode_velodyne_bin(read) == path.read_bytes()


@pytest.mark.real
def test_real_scan_cut_at_any_byte(real_data, tmp_path):
    path = next((real_data / "kitti_stereo2015/training/velodyne").glob("*.bin"))
    data = path.read_bytes()[:1600]
    cut = tmp_path / "cut.bin"
    for size in range(1, 1600):
        cut.write_bytes(data[:size])
        if size % 16 == 0:
            assert len(read_velodyne_bin(cut)) == size // 16
            continue
        with pytest.raises(PointFileTruncated, match=f"{size} bytes: {size // 16} points") as error:
            read_velodyne_bin(cut)
        assert f"and {size % 16} bytes" in error.value.got
        assert ("--record-size 20" in error.value.fix) is (size % 20 == 0)
        assert error.value.path == str(cut)


def test_records_of_20_bytes(tmp_path):
    values = np.arange(15, dtype="<f4").reshape(3, 5)
    path = tmp_path / "nuscenes.bin"
    path.write_bytes(values.tobytes())
    with pytest.raises(PointFileTruncated, match="--record-size 20"):
        read_velodyne_bin(path)
    read = read_velodyne_bin(path, record_bytes=20)
    np.testing.assert_array_equal(read.xyz, values[:, :3])
    np.testing.assert_array_equal(read.reflectance, values[:, 3])
    with pytest.raises(StructureError):
        read_velodyne_bin(path, record_bytes=10)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1.1e4, -1e30])
@pytest.mark.parametrize("column", [0, 1, 2])
def test_implausible_points_are_dropped_and_counted(scan, bad, column):
    path, values = scan
    values[10:20, column] = bad
    path.write_bytes(values.tobytes())
    read = read_velodyne_bin(path)
    assert read.dropped == 10
    np.testing.assert_array_equal(read.xyz, np.delete(values, np.s_[10:20], 0)[:, :3])
    np.testing.assert_array_equal(read.reflectance, np.delete(values, np.s_[10:20], 0)[:, 3])
    values[20, column] = bad  # one more than 10 %
    path.write_bytes(values.tobytes())
    with pytest.raises(PointFileCorrupt, match="11 of 100") as error:
        read_velodyne_bin(path)
    assert "Velodyne" in error.value.fix


def test_reflectance_that_is_no_number_counts_too(scan):
    path, values = scan
    values[3, 3] = np.nan
    path.write_bytes(values.tobytes())
    assert read_velodyne_bin(path).dropped == 1


def test_random_bytes_are_refused(tmp_path):
    path = tmp_path / "noise.bin"
    path.write_bytes(np.random.default_rng(2).bytes(16_000))
    with pytest.raises(PointFileCorrupt):
        read_velodyne_bin(path)


def test_empty_file_is_a_scan_without_points(tmp_path):
    path = tmp_path / "empty.bin"
    path.touch()
    read = read_velodyne_bin(path)
    assert (len(read), read.dropped) == (0, 0)
    assert encode_velodyne_bin(read) == b""


def test_missing_and_too_large(scan, tmp_path):
    with pytest.raises(PointFileMissing):
        read_velodyne_bin(tmp_path / "absent.bin")
    with pytest.raises(LimitError):
        read_velodyne_bin(scan[0], limits=Limits(points=99))


# --- writing -------------------------------------------------------------------------------


def points(data: bytes) -> np.ndarray:
    return np.frombuffer(data, "<f4").reshape(-1, 4)


def test_cloud_without_holes_behind_or_far_points():
    xyz = np.array(
        [[1, 2, 3], [np.nan] * 3, [-1, 0, 0], [0, -5, 1], [np.inf, 0, 0], [2e4, 0, 0]], np.float32
    )
    cloud = PointCloud(xyz, "velodyne", intensity=np.linspace(0, 1, 6, dtype=np.float32))
    np.testing.assert_array_equal(
        points(encode_velodyne_bin(cloud)), np.float32([[1, 2, 3, 0], [0, -5, 1, 0.6]])
    )


def test_scan_keeps_its_whole_turn():
    xyz = np.array([[-1, 2, 3], [np.nan] * 3], np.float32)
    written = points(encode_velodyne_bin(LidarScan(xyz)))
    assert written.tolist() == [[-1, 2, 3, 1]]


def test_unknown_reflectance_is_one(make_cloud):
    cloud = replace(make_cloud(60), frame="base_link", intensity=None)
    written = points(encode_velodyne_bin(cloud))
    assert len(written) == np.count_nonzero(cloud.xyz[:, 0] >= 0)
    assert (written[:, 3] == 1).all()
    holed = np.full(60, np.nan, np.float32)
    assert (points(encode_velodyne_bin(replace(cloud, intensity=holed)))[:, 3] == 1).all()


@pytest.mark.parametrize("frame", ["camera_left", "camera_right", "cam2", "left_optical"])
def test_optical_frames_are_refused(frame, make_cloud):
    with pytest.raises(StructureError, match="z is forward") as error:
        encode_velodyne_bin(replace(make_cloud(3), frame=frame))
    assert "Transform" in error.value.fix
