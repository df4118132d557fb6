from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import PointFileMissing, PointFileTruncated, SequenceTime, SourceEmpty
from pseudolidar.formats.points.npz import write_npz
from pseudolidar.formats.points.pcd import write_pcd
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.formats.points.velodyne_bin import write_velodyne_bin
from pseudolidar.sources.cloud_files import CloudFiles
from pseudolidar.sources.recognise import recognise
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.recorded import RecordedCloud

NS = 10**9


@pytest.fixture
def cloud(make_cloud: Callable[..., PointCloud]) -> PointCloud:
    return replace(make_cloud(10), timestamp_ns=0)


def test_natural_order_safe_names_and_synthetic_times(cloud: PointCloud, tmp_path: Path) -> None:
    for name in ("10", "9", "2", "b,c", "CON"):
        write_pcd(tmp_path / f"{name}.pcd", cloud)
    (tmp_path / "notes.txt").write_text("not a cloud")
    settings = recognise(str(tmp_path))
    assert isinstance(settings, CloudFiles)
    source = pickle.loads(pickle.dumps(settings.open()))
    assert source.yields is RecordedCloud
    assert source.rig is None
    assert source.ids == ("2", "9", "10", "%43ON", "b%2Cc")
    assert source.timestamps_ns == tuple(NS + i * NS // 10 for i in range(5))
    assert any("synthetic" in note for note in source.summary.notes)
    frame = source.load(1)
    assert (frame.id, frame.index, frame.cloud.timestamp_ns) == ("9", 1, 0)


def test_times_are_those_that_all_files_note(cloud: PointCloud, tmp_path: Path) -> None:
    for index, write in enumerate((write_pcd, write_ply, write_npz)):
        suffix = write.__name__.removeprefix("write_")
        write(tmp_path / f"{index}.{suffix}", replace(cloud, timestamp_ns=50 * NS + index))
    source = CloudFiles(str(tmp_path)).open()
    assert source.timestamps_ns == tuple(50 * NS + index for index in range(3))
    assert "1 PCD, 1 PLY, 1 NPZ" in source.summary.line
    assert CloudFiles(str(tmp_path), synthetic_times=True).open().timestamps_ns[0] == NS
    write_pcd(tmp_path / "3.pcd", cloud)  # notes none
    assert CloudFiles(str(tmp_path)).open().timestamps_ns[0] == NS
    write_pcd(tmp_path / "3.pcd", replace(cloud, timestamp_ns=NS))
    with pytest.raises(SequenceTime, match="frame 3"):
        CloudFiles(str(tmp_path)).open()


def test_times_of_names_and_of_files_beside(cloud: PointCloud, tmp_path: Path) -> None:
    named = tmp_path / "named"
    named.mkdir()
    for stamp in ("1317013333044327963", "1317013333147000000"):
        write_pcd(named / f"{stamp}.pcd", cloud)
    source = CloudFiles(str(named)).open()
    assert source.timestamps_ns == (1317013333044327963, 1317013333147000000)
    assert source.load(0).cloud.timestamp_ns == 1317013333044327963
    data = tmp_path / "velodyne" / "data"
    data.mkdir(parents=True)
    for number in (0, 2):  # 1 is missing: lines belong to numbers
        write_pcd(data / f"{number:010d}.pcd", cloud)
    lines = [f"2011-09-26 13:02:4{second}.000000001\n" for second in range(3)]
    (tmp_path / "velodyne" / "timestamps.txt").write_text("".join(lines))
    times = CloudFiles(str(data)).open().timestamps_ns
    assert times[1] - times[0] == 2 * NS
    assert times[0] % NS == 1


def test_the_format_that_keeps_most_of_equal_names(cloud: PointCloud, tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", cloud)
    write_npz(tmp_path / "a.npz", cloud)
    write_velodyne_bin(tmp_path / "a.bin", replace(cloud, frame="velodyne"))
    write_velodyne_bin(tmp_path / "b.bin", replace(cloud, frame="velodyne"))
    source = CloudFiles(str(tmp_path)).open()
    assert [file.name for file in source.files] == ["a.npz", "b.bin"]
    assert any("2 files left out" in note for note in source.summary.notes)


def test_an_output_folder_of_convert_and_a_single_file(cloud: PointCloud, tmp_path: Path) -> None:
    write_pcd(tmp_path / "out" / "pcd" / "x.pcd", cloud)
    write_npz(tmp_path / "out" / "npz" / "x.npz", cloud)
    source = recognise(str(tmp_path / "out")).open()
    assert source.ids == ("x",)
    assert recognise(str(tmp_path / "out" / "pcd" / "x.pcd")).open().ids == ("x",)
    with pytest.raises(SourceEmpty):
        CloudFiles(str(tmp_path / "nothing")).open()


def test_broken_headers_are_refused_when_opened_and_bodies_when_loaded(
    cloud: PointCloud, tmp_path: Path
) -> None:
    for name in "abc":
        write_pcd(tmp_path / f"{name}.pcd", cloud)
    whole = (tmp_path / "a.pcd").read_bytes()
    (tmp_path / "a.pcd").write_bytes(whole[:40])
    (tmp_path / "b.pcd").write_bytes(whole[:-1])
    source = CloudFiles(str(tmp_path)).open()
    assert [name for name, _ in source.refused] == ["a"]
    assert source.ids == ("b", "c")
    with pytest.raises(PointFileTruncated, match=r"b\.pcd"):
        source.load(0)
    assert len(source.load(1).cloud) == 10


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no symbolic links here")
def test_links_are_followed_once_and_loops_refused(cloud: PointCloud, tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "in", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    write_pcd(elsewhere / "real.pcd", cloud)
    (folder / "a.pcd").symlink_to(elsewhere / "real.pcd")
    (folder / "loop.pcd").symlink_to(folder / "pool.pcd")
    (folder / "pool.pcd").symlink_to(folder / "loop.pcd")
    (folder / "gone.pcd").symlink_to(tmp_path / "nothing.pcd")
    (folder / "inside.pcd").symlink_to(folder)  # a folder is no cloud
    source = CloudFiles(str(folder)).open()
    assert source.ids == ("a",)
    assert len(source.load(0).cloud) == 10
    assert sorted(name for name, _ in source.refused) == ["gone", "loop", "pool"]
    assert all(isinstance(error, PointFileMissing) for _, error in source.refused)
    assert "Too many levels" in str(dict(source.refused)["loop"])
    (tmp_path / "round").symlink_to(tmp_path / "round")
    with pytest.raises(SourceEmpty):
        CloudFiles(str(tmp_path / "round")).open()


def test_reflectances_of_other_scales_stay_as_they_are(tmp_path: Path) -> None:
    xyz = np.random.default_rng(1).normal(size=(6, 3)).astype(np.float32)
    for name, top in (("a", 1.0), ("b", 255.0)):
        scan = LidarScan(xyz, np.linspace(0, top, 6, dtype=np.float32))
        write_velodyne_bin(tmp_path / f"{name}.bin", scan)
    source = CloudFiles(str(tmp_path)).open()
    own, other = source.load(0).cloud, source.load(1).cloud
    assert own.intensity is not None
    assert other.intensity is None
    np.testing.assert_array_equal(other.extra["intensity"], np.linspace(0, 255, 6, dtype="f4"))


def test_archives_without_points_are_no_clouds(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", disparity=np.zeros((3, 3)))
    assert not CloudFiles.looks_like(tmp_path)
