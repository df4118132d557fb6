"""Clouds of many frames as one: where the points lie, what they keep, what is said."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.formats.points.npz import encode_npz
from pseudolidar.formats.points.ply import encode_ply
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.geometry.frame_chain import between
from pseudolidar.geometry.voxels import best_of_voxel
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import RecordedCloud
from tests.recordings import (
    named_clouds,
    ros2_messages,
    small_drive,
    write_own,
    write_ros2_bag,
)

STREET = Synthetic("street", frames=3, width_px=240)


def along(index: int, *, step_m: float = 2.0, start_m: float = 0.0) -> tuple[Pose, ...]:
    """A tree whose body moves along x of `map`, turned to the left, the sensor 1 m above it."""
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    place = np.array([start_m + step_m * index, 0.0, 0.0])
    return (
        Pose.identity("map", "odom"),
        Pose.from_rotation("odom", "base_link", turned, place),
        Pose.from_rotation("base_link", "velodyne", np.eye(3), np.array([0.0, 0.0, 1.0])),
    )


def moving(frames: int = 4, **how: float) -> list[RecordedCloud]:
    names = [f"f{index}" for index in range(frames)]
    return [replace(f, tree=along(f.index, **how)) for f in named_clouds(names)]


def in_map(frame: RecordedCloud) -> np.ndarray:
    """(x, y, z) of the sensor is (step - y, x, z + 1) of the map."""
    x, y, z = frame.cloud.xyz.astype(np.float64).T
    return np.column_stack([frame.tree[1].translation_m[0] - y, x, z + 1])


def merge(*args: object) -> int:
    return main(["merge", *map(str, args)])


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_own(tmp_path / "drive.mcap", moving())


@pytest.mark.parametrize("kind", ["ply", "pcd", "npz"])
def test_points_lie_where_the_poses_put_them_with_all_columns(
    kind: str, drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / f"all.{kind}"
    assert merge(drive, out) == 0
    cloud, frames = read_cloud(out), moving()
    assert (cloud.frame, len(cloud)) == ("map", 160)
    np.testing.assert_allclose(cloud.xyz, np.concatenate(list(map(in_map, frames))), atol=1e-5)
    np.testing.assert_array_equal(cloud.rgb, np.concatenate([f.cloud.rgb for f in frames]))
    for name in ("ring", "flag"):
        whole = np.concatenate([f.cloud.extra[name] for f in frames])
        np.testing.assert_array_equal(cloud.extra[name], whole)
    np.testing.assert_array_equal(cloud.extra["frame_index"], np.repeat(range(4), 40))
    said = capsys.readouterr().out
    assert "frame map, by the poses of the source, which moves 6.0 m" in said
    assert "4 of 4 frames, 160 of 160 points" in said


def test_a_rendered_street_lies_in_the_world_as_its_poses_say(tmp_path: Path) -> None:
    street = "synthetic:street:3"
    narrow = ["--source.width-px", "240", "--to", "mcap,npz", "--workers", "1"]
    assert main(["convert", street, str(tmp_path / "out"), *narrow]) == 0
    assert merge(tmp_path / "out" / "street.mcap", tmp_path / "street.npz") == 0
    cloud, source = read_cloud(tmp_path / "street.npz"), STREET.open()
    for index, name in enumerate(source.ids):
        alone = read_cloud(tmp_path / "out" / "npz" / f"{name}.npz")
        T_map_velodyne = source.pose(index).matrix  # base_link is the Velodyne there
        here = alone.xyz @ T_map_velodyne[:3, :3].T + T_map_velodyne[:3, 3]
        mine = cloud.xyz[cloud.extra["frame_index"] == index]
        np.testing.assert_allclose(mine, here, atol=1e-4)
    assert np.linalg.norm(source.pose(2).translation_m) > 1


def test_cubes_keep_the_surest_point_whatever_the_workers(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    frames = [
        replace(f, cloud=replace(f.cloud, sigma_m=rng.uniform(0.01, 1, 40).astype(np.float32)))
        for f in moving(6, step_m=0.1)
    ]
    path = write_own(tmp_path / "d.mcap", frames)
    outs = [tmp_path / name for name in ("a.npz", "b.npz", "all.npz")]
    assert merge(path, outs[0], "--voxel", 0.7, "--workers", 1) == 0
    assert merge(path, outs[1], "--voxel", 0.7, "--workers", 3) == 0
    assert merge(path, outs[2]) == 0
    assert outs[0].read_bytes() == outs[1].read_bytes()
    thinned, whole = read_cloud(outs[0]), read_cloud(outs[2])
    best = best_of_voxel(whole.xyz, whole.sigma_m, voxel_m=0.7)
    assert 0 < len(best) < len(whole)
    np.testing.assert_array_equal(thinned.xyz, whole.xyz[best])
    np.testing.assert_array_equal(thinned.extra["frame_index"], whole.extra["frame_index"][best])


def test_crops_are_of_each_frame_and_boxes_of_any(drive: Path, tmp_path: Path) -> None:
    assert merge(drive, tmp_path / "near.npz", "--crop", "range::1.5") == 0
    near = read_cloud(tmp_path / "near.npz")
    want = [np.linalg.norm(f.cloud.xyz, axis=1) <= 1.5 for f in moving()]
    np.testing.assert_array_equal(
        np.bincount(near.extra["frame_index"], minlength=4), [w.sum() for w in want]
    )
    box = ("--crop", "box", "--crop.frame", "map", "--crop.x", "1:3")
    assert merge(drive, tmp_path / "box.npz", *box) == 0
    points = np.concatenate(list(map(in_map, moving())))
    inside = (points[:, 0] >= 1) & (points[:, 0] <= 3)
    np.testing.assert_allclose(read_cloud(tmp_path / "box.npz").xyz, points[inside], atol=1e-5)


def test_selected_frames_keep_their_index_and_time(drive: Path, tmp_path: Path) -> None:
    assert merge(drive, tmp_path / "a.npz", "--frames", "1::2") == 0
    assert set(read_cloud(tmp_path / "a.npz").extra["frame_index"].tolist()) == {1, 3}
    assert merge(drive, tmp_path / "b.npz", "--exclude", "f0", "--origin", "time_s") == 0
    seconds = read_cloud(tmp_path / "b.npz").extra["time_s"]
    np.testing.assert_allclose(np.unique(seconds), [0.1, 0.2, 0.3])
    assert merge(drive, tmp_path / "c.npz", "--origin", "none") == 0
    assert not {"frame_index", "time_s"} & set(read_cloud(tmp_path / "c.npz").extra)


def test_files_have_no_poses_and_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    for frame in named_clouds(["a", "b"]):
        (clouds / f"{frame.id}.ply").write_bytes(encode_ply(frame.cloud))
    assert merge(clouds, tmp_path / "all.ply") == 0
    assert (
        "frame velodyne, their own, where clouds of a moving sensor do not"
        in capsys.readouterr().out
    )
    cloud = read_cloud(tmp_path / "all.ply")
    whole = np.concatenate([f.cloud.xyz for f in named_clouds(["a", "b"])])
    np.testing.assert_array_equal(cloud.xyz, whole)


def test_far_from_the_origin_of_the_map_points_stay_apart(tmp_path: Path) -> None:
    frames = moving(2, start_m=5_428_123.25)
    path = write_own(tmp_path / "utm.mcap", frames)
    assert merge(path, tmp_path / "utm.ply") == 0
    cloud = read_cloud(tmp_path / "utm.ply")
    assert cloud.xyz.dtype == np.float64
    np.testing.assert_allclose(cloud.xyz, np.concatenate(list(map(in_map, frames))), atol=1e-6)


def test_a_bin_tells_what_it_cannot_hold(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert merge(drive, tmp_path / "all.bin") == 0
    assert ".bin without the columns rgb" in capsys.readouterr().out
    scan = read_velodyne_bin(tmp_path / "all.bin")
    points = np.concatenate(list(map(in_map, moving())))
    np.testing.assert_allclose(scan.xyz, points, atol=1e-5)


def test_columns_that_some_frames_lack(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, *others = moving(3)
    plain = replace(first, cloud=replace(first.cloud, rgb=None, intensity=None))
    path = write_own(tmp_path / "d.mcap", [plain, *others])
    assert merge(path, tmp_path / "a.npz", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["notes"] == ["not in all frames, left out: rgb"]
    cloud = read_cloud(tmp_path / "a.npz")
    assert cloud.rgb is None
    assert np.isnan(cloud.intensity[:40]).all()
    np.testing.assert_array_equal(cloud.intensity[40:80], others[0].cloud.intensity)


def test_merged_once_more_the_older_origin_is_told_of(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert merge(drive, tmp_path / "a.npz") == 0
    assert merge(tmp_path / "a.npz", tmp_path / "b.npz") == 0
    said = capsys.readouterr().out
    assert "the clouds' own column frame_index was replaced" in said
    assert "frame map, in which the clouds were already" in said


class TestFrames:
    """The common frame is the most fixed one that all reach."""

    def test_frames_that_only_some_reach_are_not_taken(self, tmp_path: Path) -> None:
        frames = moving(5)
        frames = [replace(f, tree=f.tree[1:] if f.index == 2 else f.tree) for f in frames]
        path = write_own(tmp_path / "d.mcap", frames)
        assert merge(path, tmp_path / "a.npz") == 0
        assert read_cloud(tmp_path / "a.npz").frame == "odom"

    def test_frames_that_do_not_reach_it_are_left_out_and_named(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        frames = moving(5)
        frames = [replace(f, tree=f.tree[1:] if f.index == 2 else f.tree) for f in frames]
        path = write_own(tmp_path / "d.mcap", frames)
        assert merge(path, tmp_path / "a.npz", "--frame", "map", "--json") == 4
        told = json.loads(capsys.readouterr().out)
        assert [part["frame_index"] for part in told["merged"]] == [0, 1, 3, 4]
        (skipped,) = told["skipped"]
        assert (skipped["id"], skipped["code"]) == ("f2", "CalibrationField")
        assert "odom" in skipped["want"]
        assert merge(path, tmp_path / "b.npz", "--frame", "map", "--on-error", "stop") == 3
        assert not (tmp_path / "b.npz").exists()

    def test_a_frame_that_nobody_knows(
        self, drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert merge(drive, tmp_path / "a.npz", "--frame", "mars") == 3
        assert "wanted one of velodyne, base_link, odom, map" in capsys.readouterr().err

    def test_clouds_that_nothing_ties_together(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        clouds = tmp_path / "clouds"
        clouds.mkdir()
        for frame, name in zip(named_clouds(["a", "b"]), ("left", "right"), strict=True):
            (clouds / f"{frame.id}.ply").write_bytes(encode_ply(replace(frame.cloud, frame=name)))
        assert merge(clouds, tmp_path / "all.ply") == 3
        assert "clouds in left, right, and no transforms" in capsys.readouterr().err

    def test_of_a_bag_with_pairs_the_scans_are_taken_each_at_its_own_time(
        self, tmp_path: Path
    ) -> None:
        drive = small_drive(3)
        bag = write_ros2_bag(tmp_path / "bag", ros2_messages(drive))
        assert merge(bag, tmp_path / "a.ply") == 0
        cloud = read_cloud(tmp_path / "a.ply")
        for index, (early, late) in enumerate(pairwise(drive)):
            # Scans are 7 ms later than pictures, which come every 100 ms.
            T_map_velodyne = between(early.pose, late.pose, 0.07)  # base_link is the Velodyne
            mine = cloud.xyz[cloud.extra["frame_index"] == index]
            np.testing.assert_allclose(mine, T_map_velodyne.apply(early.scan.xyz), atol=1e-4)


class TestRefused:
    def test_pairs_have_to_be_converted_first(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert merge("synthetic:street", tmp_path / "a.ply") == 3
        said = capsys.readouterr().err
        assert "a source of pairs of pictures; wanted point clouds" in said
        assert "pseudolidar convert SOURCE OUT --to mcap" in said
        drive = write_own(tmp_path / "pairs.mcap", [replace(f, scan=None) for f in small_drive(2)])
        assert merge(drive, tmp_path / "a.ply") == 3
        assert not (tmp_path / "a.ply").exists()

    def test_broken_frames_are_left_out_and_named(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        clouds = tmp_path / "clouds"
        clouds.mkdir()
        for frame in named_clouds(["a", "b", "c"]):
            (clouds / f"{frame.id}.npz").write_bytes(encode_npz(frame.cloud))
        whole = (clouds / "b.npz").read_bytes()
        (clouds / "b.npz").write_bytes(whole[: len(whole) // 2])
        (clouds / "d.ply").symlink_to(tmp_path / "nothing.ply")
        assert merge(clouds, tmp_path / "all.ply") == 4
        said = capsys.readouterr().out
        assert "2 of 4 frames" in said
        assert "skipped b: PointFileTruncated" in said
        assert "skipped d: PointFileMissing" in said
        assert len(read_cloud(tmp_path / "all.ply")) == 80

    def test_nothing_is_written_over(
        self, drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        out = tmp_path / "mine.ply"
        out.write_text("mine")
        assert merge(drive, out) == 2
        assert out.read_text() == "mine"
        assert "--overwrite" in capsys.readouterr().err
        assert merge(drive, out, "--overwrite") == 0
        assert len(read_cloud(out)) == 160

    def test_a_result_never_lies_among_its_clouds(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        frame = named_clouds(["a"])[0]
        for place in ("out/ply", "one"):
            (tmp_path / place).mkdir(parents=True)
            (tmp_path / place / "a.ply").write_bytes(encode_ply(frame.cloud))
        for source, out in (("out", "out/all.ply"), ("out", "out/ply/b.ply"), ("one", "one/b.ply")):
            assert merge(tmp_path / source, tmp_path / out) == 2
            assert "lies among the clouds" in capsys.readouterr().err
        one = tmp_path / "one" / "a.ply"
        before = one.read_bytes()
        assert merge(one, one, "--overwrite") == 2
        assert one.read_bytes() == before
        assert merge(one, tmp_path / "one" / "b.ply") == 0

    @pytest.mark.parametrize(
        ("args", "said"),
        [
            (["a.xyz"], "a file named .xyz; wanted .ply, .pcd, .bin, .npz"),
            (["a.ply", "--voxel", "0"], "cubes of 0 m"),
            (["a.ply", "--crop", "range:500:"], "not one point is left"),
            (["a.ply", "--frames", "9:"], "no frame of 4 is left"),
        ],
    )
    def test_what_cannot_be_meant(
        self,
        args: list[str],
        said: str,
        drive: Path,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        assert merge(drive, tmp_path / args[0], *args[1:]) == 2
        assert said in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]

    def test_more_points_than_memory_are_refused_and_cubes_offered(self, tmp_path: Path) -> None:
        clouds = tmp_path / "clouds"
        clouds.mkdir()
        xyz = np.zeros((100_000, 3), np.float32)
        (tmp_path / "big.ply").write_bytes(encode_ply(PointCloud(xyz, "map")))
        for index in range(400):  # 0.5 GB
            (clouds / f"{index}.ply").symlink_to(tmp_path / "big.ply")

        def limit() -> None:
            resource.setrlimit(resource.RLIMIT_DATA, (1_200_000_000, 1_200_000_000))

        def program(*args: str) -> subprocess.CompletedProcess[str]:
            command = [sys.executable, "-m", "pseudolidar.cli", "merge", str(clouds)]
            return subprocess.run(
                [*command, str(tmp_path / "all.ply"), "--workers", "1", *args],
                preexec_fn=limit,
                capture_output=True,
                text=True,
                check=False,
            )

        refused = program()
        assert refused.returncode == 3, refused.stderr
        assert "MemoryLimit" in refused.stderr
        assert "--voxel" in refused.stderr
        assert not (tmp_path / "all.ply").exists()
        assert program("--voxel", "0.1").returncode == 0
