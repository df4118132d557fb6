"""Clouds of several pairs on one body in one command, each point with the pair that saw it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pseudolidar import cli
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.sources.recording.recording import Recording
from tests.body_rigs import MOUNTS, body_rig, exact_cloud, write_pairs


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("body") / "street"
    write_pairs(folder, 1)
    return folder


@pytest.fixture(scope="module")
def converted(street: Path) -> Path:
    out = street.parent / "out"
    args = ["convert", street, out, "--to", "npz,pcd,bin,mcap", "--min-depth", 1]
    assert cli.main([str(arg) for arg in args]) == 0
    return out


def test_every_pair_is_where_the_world_is(converted: Path) -> None:
    """Points of each pair lie on what the exact depths of all pairs show, in base_link."""
    from scipy.spatial import cKDTree

    cloud = read_npz(converted / "npz" / "000000.npz")
    assert cloud.frame == "base_link"
    assert cloud.rgb is not None
    source = cloud.extra["source"]
    assert source.dtype == np.uint8
    world = np.concatenate(
        [
            exact_cloud(0, name, most_m=15).transformed(body_rig()[name].T_base_link_left).xyz
            for name in MOUNTS
        ]
    )
    tree = cKDTree(world)
    for number, name in enumerate(MOUNTS):
        points = cloud.xyz[source == number]
        assert len(points) > 10_000
        near = points[np.linalg.norm(points, axis=1) < 8]
        off_m = tree.query(near)[0]
        assert np.median(off_m) < 0.03, name
        # Pairs look where they are mounted: to the left, y is above 0.
        mean = np.degrees(np.arctan2(near[:, 1].mean(), near[:, 0].mean()))
        assert abs(mean - MOUNTS[name][0]) < 25, name


def test_the_clouds_are_those_of_the_pairs_alone(street: Path, converted: Path) -> None:
    cloud = read_npz(converted / "npz" / "000000.npz")
    alone = street.parent / "alone"
    rig = f"{street / 'rig.json'}#left"
    args = ["convert", street / "left", alone, "--rig", rig, "--to", "npz", "--min-depth", 1]
    assert cli.main([str(arg) for arg in args]) == 0
    one = read_npz(alone / "npz" / "000000.npz")
    one = one[one.valid]
    want = one.transformed(body_rig()["left"].T_base_link_left)
    mine = cloud[cloud.extra["source"] == 1]
    np.testing.assert_array_equal(mine.xyz, want.xyz)
    np.testing.assert_array_equal(mine.sigma_m, want.sigma_m)
    np.testing.assert_array_equal(mine.rgb, want.rgb)


def test_other_files_hold_the_same_points_and_say_who_saw_them(converted: Path) -> None:
    cloud = read_npz(converted / "npz" / "000000.npz")
    pcd = read_pcd(converted / "pcd" / "000000.pcd")
    np.testing.assert_array_equal(pcd.extra["source"], cloud.extra["source"])
    assert len((converted / "bin" / "000000.bin").read_bytes()) == 16 * len(cloud)
    run = (converted / "run.json").read_text()
    assert "column source: 0 front, 1 left, 2 right" in run
    assert "points_front" in (converted / "report.json").read_text()


def test_cameras_of_all_pairs_are_in_the_recording(converted: Path) -> None:
    frame = Recording(str(converted / "street.mcap")).open().load(0)
    places = {pose.src: pose for pose in frame.tree if pose.dst == "base_link"}
    for name in MOUNTS:
        got = places[f"{name}_camera_left"].matrix
        np.testing.assert_allclose(got, body_rig()[name].T_base_link_left.matrix, atol=1e-9)
        assert f"{name}_camera_right" in places


def test_a_pair_that_shows_nothing_costs_its_points_alone(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import shutil

    import cv2

    broken = tmp_path / "broken"
    shutil.copytree(street, broken)
    for eye in ("left", "right"):
        path = str(broken / "right" / eye / "000000.png")
        cv2.imwrite(path, np.zeros_like(cv2.imread(path)))
    args = ["convert", broken, tmp_path / "out", "--to", "npz", "--no-check"]
    assert cli.main([str(arg) for arg in args]) == 0
    cloud = read_npz(tmp_path / "out" / "npz" / "000000.npz")
    assert set(np.unique(cloud.extra["source"])) == {0, 1}
    assert "right left out: PairIdentical" in (tmp_path / "out" / "report.json").read_text()


@pytest.mark.parametrize(
    ("flags", "code", "words"),
    [
        (("--depth", "maps"), 3, "pairs of several rigs on one body"),
        (("--frame", "velodyne"), 3, "no transforms from 'base_link' to 'velodyne'"),
        (("--swap",), 3, "pairs of several rigs on one body"),
    ],
)
def test_what_makes_no_sense_for_a_body_is_refused(
    flags: tuple[str, ...], code: int, words: str, street: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "maps").mkdir()
    flags = tuple(str(tmp_path / flag) if flag == "maps" else flag for flag in flags)
    got = cli.main(["convert", str(street), str(tmp_path / "out"), *flags])
    streams = capsys.readouterr()
    report = tmp_path / "out" / "report.json"
    told = streams.err + streams.out + (report.read_text() if report.exists() else "")
    assert words in told
    assert got == code
