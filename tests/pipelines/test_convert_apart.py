"""A run never destroys what it reads, whatever is asked for."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pseudolidar.cli import main
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.points.npz import encode_npz
from pseudolidar.formats.points.pcd import encode_pcd
from pseudolidar.structures.cloud import PointCloud
from tests.pipelines.conftest import write_drive
from tests.recordings import (
    START_NS,
    named_clouds,
    ros2_messages,
    small_drive,
    write_own,
    write_ros2_bag,
)


@pytest.fixture
def clouds(make_cloud: Callable[..., PointCloud], tmp_path: Path) -> Path:
    """A folder whose clouds lie in `pcd`, as `convert` leaves it."""
    for index in range(3):
        cloud = replace(make_cloud(20), timestamp_ns=START_NS + index)
        write_atomic(tmp_path / "clouds" / "pcd" / f"{index}.pcd", encode_pcd(cloud))
    return tmp_path / "clouds"


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> None:
    capsys.readouterr()
    assert main(["convert", *map(str, arguments), "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert "holds what is read" in error["got"]
    assert error["fix"] == "Choose another output folder."


def test_a_recording_is_not_replaced_by_its_own_conversion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_own(tmp_path / "drive.mcap", named_clouds(["a", "b"]))
    before = contents(tmp_path)
    for flags in ((), ("--overwrite",)):
        refused(capsys, path, tmp_path, "--to", "mcap", *flags)
    refused(capsys, path, tmp_path, "--to", "pcd", "--overwrite")
    refused(capsys, tmp_path, tmp_path, "--to", "mcap")
    assert contents(tmp_path) == before
    assert main(["convert", str(path), str(tmp_path), "--to", "pcd"]) == 0
    assert contents(tmp_path)["drive.mcap"] == before["drive.mcap"]


def test_a_bag_is_not_replaced_by_its_own_conversion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_ros2_bag(tmp_path / "bag", ros2_messages(small_drive(2)), "mcap")
    before = contents(bag)
    for flags in (("--mcap.profile", "ros2"), ("--overwrite",)):
        refused(capsys, bag, bag, "--to", "mcap", *flags)
    assert contents(bag) == before


def test_clouds_are_not_replaced_by_themselves(
    clouds: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(clouds)
    (tmp_path / "link").symlink_to(clouds / "pcd")
    for source in (clouds, clouds / "pcd", tmp_path / "link", clouds / "pcd" / "1.pcd"):
        refused(capsys, source, clouds, "--to", "pcd", "--crop", "range:2:20")
        refused(capsys, source, clouds, "--to", "ply", "--overwrite")
    assert contents(clouds) == before


def test_a_converted_folder_is_not_lost_by_what_its_error_advises(
    clouds: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Other settings are refused with the advice to overwrite: that must not delete the clouds."""
    out = tmp_path / "out"
    assert main(["convert", str(clouds), str(out), "--to", "npz"]) == 0
    before = contents(out / "npz")
    assert main(["convert", str(out), str(out), "--to", "ply"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    refused(capsys, out, out, "--to", "ply", "--overwrite")
    assert contents(out / "npz") == before


def test_given_maps_are_not_replaced(
    tmp_path: Path, drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["convert", str(drive), str(out), "--to", "disparity", "--frames", "0:2"]) == 0
    before = contents(out / "disparity")
    maps = ["--disparity", out / "disparity", "--frames", "0:2", "--overwrite"]
    refused(capsys, drive, out, "--to", "npz", *maps)
    assert contents(out / "disparity") == before


def test_what_lies_beside_may_stay_there(
    make_cloud: Callable[..., PointCloud],
    drive: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Clouds in the folder itself, and pairs: nothing that is written is one of them."""
    for index in range(2):
        cloud = replace(make_cloud(20), timestamp_ns=START_NS + index)
        write_atomic(tmp_path / "npz" / f"{index}.npz", encode_npz(cloud))
    shutil.copytree(drive, tmp_path / "pairs")
    for folder, to in (("npz", "ply"), ("pairs", "pcd")):
        place = str(tmp_path / folder)
        before = contents(tmp_path / folder)
        for flags in ([], [], ["--overwrite"]):
            command = ["convert", place, place, "--to", to, "--frames", "0:2"]
            assert main([*command, *flags]) == 0
        after = contents(tmp_path / folder)
        assert {name: after[name] for name in before} == before
        assert len([name for name in after if name.endswith(f".{to}")]) == 2
    monkeypatch.chdir(tmp_path / "npz")
    assert main(["convert", ".", ".", "--to", "ply", "--frames", "0:2"]) == 0


def test_a_comparison_never_removes_what_it_compares(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its output folder is the one that holds the source, or the reference."""
    assert main(["synth", str(tmp_path / "a"), "--layout", "stereo", "--frames", "1"]) == 0
    theirs = tmp_path / "b"
    args = ["convert", str(tmp_path / "a"), str(theirs), "--to", "disparity"]
    assert main(args) == 0
    before = contents(tmp_path)
    for source, out, reference in (
        (tmp_path / "a", tmp_path / "a", "scan"),
        (tmp_path / "a", theirs, theirs / "disparity"),
    ):
        capsys.readouterr()
        wanted = ["--out", str(out), "--reference", str(reference), "--overwrite", "--json"]
        assert main(["compare", str(source), *wanted]) == 2
        assert "holds what is read" in json.loads(capsys.readouterr().out)["error"]["got"]
    assert contents(tmp_path) == before


@pytest.mark.parametrize("verb", [["convert", "--to", "pcd"], ["compare", "--to", "pcd"]])
def test_data_that_an_earlier_run_made_are_not_removed_from_under_it(
    verb: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The journal of `synth` names the pictures that are then the source."""
    data = tmp_path / "data"
    assert main(["synth", str(data), "--layout", "stereo", "--frames", "1"]) == 0
    before = contents(data)
    capsys.readouterr()
    name, *flags = verb
    place = ["--out", str(data)] if name == "compare" else [str(data)]
    assert main([name, str(data), *place, *flags, "--overwrite", "--json"]) == 2
    assert "holds what is read" in json.loads(capsys.readouterr().out)["error"]["got"]
    assert contents(data) == before


def test_clouds_beside_the_pictures_are_made_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_drive(tmp_path / "drive", 2)
    for to in ("pcd", "ply"):
        assert main(["convert", str(drive), str(drive), "--to", to, "--overwrite"]) == 0
    assert not list((drive / "pcd").glob("*.pcd"))
    assert len(list((drive / "ply").glob("*.ply"))) == 2
