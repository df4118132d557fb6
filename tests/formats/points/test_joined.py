"""Files of clouds joined without reading them all."""

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.clouds.merge import merged
from pseudolidar.errors import (
    PointFileCorrupt,
    PointFileField,
    PointFileMissing,
    PointFileTruncated,
)
from pseudolidar.formats.points.joined import JOINERS, join_clouds
from pseudolidar.running.one_cloud import write_cloud
from pseudolidar.structures.cloud import PointCloud


def tile(seed: int, points: int) -> PointCloud:
    rng = np.random.default_rng(seed)
    return PointCloud(
        rng.normal(size=(points, 3)).astype(np.float32),
        "map",
        rgb=rng.integers(0, 256, (points, 3), np.uint8),
        sigma_m=rng.random(points, np.float32),
        extra={"nx": rng.random(points, np.float32), "views": np.full(points, seed, np.uint16)},
    )


@pytest.mark.parametrize("suffix", JOINERS)
def test_the_bytes_are_those_of_all_points_written_at_once(tmp_path: Path, suffix: str):
    tiles = [tile(seed, points) for seed, points in ((1, 7), (2, 1), (3, 95))]
    files = [tmp_path / f"{number}{suffix}" for number in range(3)]
    for file, cloud in zip(files, tiles, strict=True):
        write_cloud(file, cloud)
    write_cloud(tmp_path / f"at_once{suffix}", merged(tiles))
    join_clouds(files, tmp_path / f"joined{suffix}")
    assert (tmp_path / f"joined{suffix}").read_bytes() == (
        tmp_path / f"at_once{suffix}"
    ).read_bytes()


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".npz"])
def test_other_columns_are_refused_by_their_file(tmp_path: Path, suffix: str):
    files = [tmp_path / f"{name}{suffix}" for name in ("one", "other")]
    write_cloud(files[0], tile(1, 5))
    write_cloud(files[1], PointCloud(np.zeros((3, 3), np.float32), "map"))
    with pytest.raises(PointFileField, match="other"):
        join_clouds(files, tmp_path / f"joined{suffix}")
    assert not (tmp_path / f"joined{suffix}").exists()


@pytest.mark.parametrize("suffix", JOINERS)
@pytest.mark.parametrize("left", [0.3, 0.999])
def test_a_file_that_is_cut_is_named(tmp_path: Path, suffix: str, left: float):
    files = [tmp_path / f"{name}{suffix}" for name in ("one", "cut", "other")]
    for file in files:
        write_cloud(file, tile(1, 500))
    data = files[1].read_bytes()
    files[1].write_bytes(data[: int(left * len(data)) | 1])  # within a point
    with pytest.raises((PointFileTruncated, PointFileCorrupt), match=rf"cut\{suffix}"):
        join_clouds(files, tmp_path / f"joined{suffix}")
    assert not (tmp_path / f"joined{suffix}").exists()


@pytest.mark.parametrize("suffix", JOINERS)
def test_a_file_that_is_gone_is_named(tmp_path: Path, suffix: str):
    files = [tmp_path / f"{name}{suffix}" for name in ("one", "gone", "other")]
    for file in (files[0], files[2]):
        write_cloud(file, tile(1, 5))
    with pytest.raises(PointFileMissing, match=rf"gone\{suffix}"):
        join_clouds(files, tmp_path / f"joined{suffix}")
    assert not (tmp_path / f"joined{suffix}").exists()


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_a_file_that_ends_within_its_header_is_named(tmp_path: Path, suffix: str):
    write_cloud(tmp_path / f"cut{suffix}", tile(1, 5))
    data = (tmp_path / f"cut{suffix}").read_bytes()
    (tmp_path / f"cut{suffix}").write_bytes(data[:60])
    with pytest.raises(PointFileTruncated, match=rf"cut\{suffix}"):
        join_clouds([tmp_path / f"cut{suffix}"], tmp_path / f"joined{suffix}")
