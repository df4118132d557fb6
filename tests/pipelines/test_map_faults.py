"""Sequences that are not what they should be, as `map` tells of them (faults 44, 46 to 48)."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.tum import read_tum_trajectory
from pseudolidar.running.mapped.walk import Walk

SIZE = ["--width-px", "320", "--height-px", "128"]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("kitti")
    assert main(["synth", str(root), "--layout", "odometry", "--frames", "6", *SIZE]) == 0
    return root


@pytest.fixture
def root(sound: Path, tmp_path: Path) -> Path:
    """The same, to be spoilt: links to what stays as it is."""
    for file in sound.rglob("*"):
        if file.is_file():
            copy = tmp_path / "kitti" / file.relative_to(sound)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(file.read_bytes())
    return tmp_path / "kitti"


def told(capsys: pytest.CaptureFixture[str], root: Path, *more: str) -> tuple[int, Any]:
    capsys.readouterr()
    code = main(["map", str(root), str(root.parent / "out"), "--to", "none", "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def test_poses_that_are_fewer_than_frames_are_counted(root: Path, capsys):
    (file,) = root.rglob("poses/*.txt")
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:4]))
    code, answer = told(capsys, root)
    error = answer["error"]
    assert (code, error["code"], error["path"]) == (3, "PoseFileError", str(file))
    assert "4 poses" in error["got"]
    assert "6" in error["want"]


@pytest.mark.parametrize("spoilt", ["backwards", "equal"])
def test_times_that_do_not_increase_are_refused_by_their_row(root: Path, capsys, spoilt: str):
    (file,) = root.rglob("times.txt")
    times = file.read_text().split()
    times[3] = times[2] if spoilt == "equal" else times[0]
    file.write_text("\n".join(times) + "\n")
    code, answer = told(capsys, root)
    assert code != 0
    assert answer["error"]["code"] == "SequenceTime"
    assert str(file) == answer["error"]["path"]
    assert not list((root.parent / "out").glob("trajectory*"))


def test_a_gap_in_the_times_is_told(root: Path, capsys):
    (file,) = root.rglob("times.txt")
    times = [float(time) for time in file.read_text().split()]
    file.write_text("\n".join(f"{t + (5 if i > 3 else 0):e}" for i, t in enumerate(times)) + "\n")
    assert told(capsys, root, "--odometry", "vision")[0] == 0
    report = (root.parent / "out" / "report.html").read_text()
    assert "gap" in report


def test_a_run_that_is_stopped_says_so(root: Path, capsys, monkeypatch: pytest.MonkeyPatch):
    step = Walk.step

    def stopping(walk: Walk, *seen: Any) -> Any:
        if len(walk.placed) == 1:
            os.kill(os.getpid(), signal.SIGINT)
        return step(walk, *seen)

    monkeypatch.setattr(Walk, "step", stopping)
    out = str(root.parent / "out")
    assert main(["map", str(root), out, "--to", "none", "--odometry", "vision"]) == 130
    said = capsys.readouterr()
    assert "the same command continues" in said.out
    assert "lost" not in said.out + said.err


def test_scans_without_shape_are_lost_and_nothing_is_made_up(root: Path, capsys):
    scans = sorted(root.rglob("velodyne/*.bin"))
    few = np.fromfile(scans[2], np.float32).reshape(-1, 4)[:3]
    few.tofile(scans[2])
    np.full((500, 4), np.nan, np.float32).tofile(scans[3])
    code, answer = told(capsys, root, "--odometry", "kiss")
    path = answer["trajectory"]
    lost = set(path["lost"]) | {f"{number:06d}" for number in range(6)} - placed(root)
    assert {"000002", "000003"} <= lost
    assert code in (0, 4)
    assert path["frames"] == 4
    assert path["end_error_rel"] < 0.05


def placed(root: Path) -> set[str]:
    times, _ = read_tum_trajectory(root.parent / "out" / "trajectory.tum")
    return {f"{round((time / 1e9 - 1) * 10):06d}" for time in times}
