"""Videos through `convert`: the clouds of the pictures, damage, files that are none."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.convert import Convert, run
from pseudolidar.cli import main
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.selection import FrameSelection
from tests.videos import write_video


def eye(drive: Path, name: str) -> list[np.ndarray]:
    files = sorted((drive / name).iterdir())
    return [np.ascontiguousarray(cv2.imread(str(file))[:, :, ::-1]) for file in files]


@pytest.fixture(scope="module")
def videos(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny drive as two videos and as one; not to be changed."""
    folder = tmp_path_factory.mktemp("videos")
    left, right = eye(drive, "left"), eye(drive, "right")
    write_video(folder / "two" / "left.mkv", left, gop=5)
    write_video(folder / "two" / "right.mkv", right, gop=5)
    both = [np.hstack(pair) for pair in zip(left, right, strict=True)]
    write_video(folder / "one" / "drive.mkv", both, gop=5)
    for kind in ("two", "one"):
        (folder / kind / "rig.json").write_text((drive / "rig.json").read_text())
    return folder


def files(place: Path, out: Path, **settings) -> dict[str, bytes]:
    job = Convert(recognise(str(place)), out, Outputs(("npz", "pcd")), **settings)
    assert run(job).exit_code == 0
    found = [path for kind in ("npz", "pcd") for path in (out / kind).iterdir()]
    return {str(path.relative_to(out)): path.read_bytes() for path in found}


def test_the_files_are_those_of_the_pictures_for_any_number_of_workers(videos, drive, tmp_path):
    want = files(drive, tmp_path / "pictures")
    assert files(videos / "two", tmp_path / "two", workers=1) == want
    assert files(videos / "two", tmp_path / "two again", workers=2) == want
    assert files(videos / "one", tmp_path / "one", workers=3) == want


def test_a_selection_of_a_video_is_that_of_the_pictures(videos, drive, tmp_path):
    some = {
        "frames": FrameSelection.parse("1:12:3"),
        "exclude": FrameSelection.parse("7"),
    }
    want = files(drive, tmp_path / "pictures", **some)
    assert len(want) == 6
    assert files(videos / "one", tmp_path / "one", **some) == want


def test_a_video_that_is_none_is_refused_and_named(videos, tmp_path, capsys):
    (tmp_path / "cut.mp4").write_bytes(b"\x00\x00\x00\x18ftypisom" + bytes(2000))
    (tmp_path / "rig.json").write_text((videos / "one" / "rig.json").read_text())
    assert main(["convert", str(tmp_path / "cut.mp4"), str(tmp_path / "out"), "--json"]) == 3
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "VideoUnreadable"
    assert "without its directory" in error["got"]
    assert not (tmp_path / "out").exists()


def test_a_cut_video_is_converted_as_far_as_it_goes(videos, tmp_path, capsys):
    data = bytearray((videos / "one" / "drive.mkv").read_bytes())
    data[len(data) // 4] ^= 0xFF  # a frame of the first group
    (tmp_path / "drive.mkv").write_bytes(data[: round(0.8 * len(data))])
    (tmp_path / "rig.json").write_text((videos / "one" / "rig.json").read_text())
    out = tmp_path / "out"
    assert main(["convert", str(tmp_path), str(out), "--to", "npz"]) == 4
    whole = {path.name: path.read_bytes() for path in files_of(videos, tmp_path / "whole")}
    made = {path.name: path.read_bytes() for path in (out / "npz").iterdir()}
    assert 5 <= len(made) < len(whole)
    assert all(whole[name] == data for name, data in made.items())
    report = json.loads((out / "report.json").read_text())
    assert {skip["code"] for skip in report["skipped"]} == {"VideoDamaged"}
    assert "VideoDamaged" in capsys.readouterr().out


def files_of(videos: Path, out: Path) -> list[Path]:
    run(Convert(recognise(str(videos / "one")), out, Outputs(("npz",))))
    return list((out / "npz").iterdir())
