"""Sequences that are not what they should be, as `map` tells of them (faults 44, 46 to 48)."""

from __future__ import annotations

import csv
import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from pseudolidar.cli import main
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.tum import read_tum_trajectory
from pseudolidar.running.mapped.walk import Walk

RATE_HZ = 20
SIZE = ["--width-px", "320", "--height-px", "128", "--rate", str(RATE_HZ)]


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


def test_scans_without_shape_are_extrapolated_or_left_out(root: Path, capsys):
    scans = sorted(root.rglob("velodyne/*.bin"))
    few = np.fromfile(scans[2], np.float32).reshape(-1, 4)[5000:5003]
    few.tofile(scans[2])
    np.full((500, 4), np.nan, np.float32).tofile(scans[3])
    scans[5].write_bytes(b"")
    code, answer = told(capsys, root, "--odometry", "kiss")
    path = answer["trajectory"]
    # Points that are all NaN are no scan of a Velodyne: the file is refused, and its frame with it.
    assert (code, answer["skipped"]) == (4, 1)
    assert path["extrapolated"] == ["000002"]
    assert path["lost"] == ["000005"]
    assert path["ended"] == []
    assert placed(root) == ["000000", "000001", "000002", "000004"]
    assert path["end_error_rel"] < 0.05
    odd = {"scans": 5, "empty": 1, "few": 1, "unplaced": 0}
    assert path["scans"] == odd | {"dropped_points": 0, "deskewed": 0}
    out = root.parent / "out"
    assert "1 of 4 poses are extrapolated" in (out / "trajectory.tum").read_text().split("\n")[0]
    rows = list(csv.DictReader((out / "frames.csv").open()))
    statuses = ["first", "ok", "extrapolated", "skipped", "ok", "lost"]
    assert [row["status"] for row in rows] == statuses
    assert [row["row"] for row in rows] == ["1", "2", "3", "", "4", ""]
    assert "finite" in rows[3]["why"]
    assert float(rows[2]["sigma_m"]) > 0.01
    assert "3 points" in rows[2]["why"]
    report = (out / "report.html").read_text()
    assert "1 extrapolated" in report
    assert "no usable point" in report
    assert "2 of 5 scans left out: 1 without a usable point, 1 with too few" in report


def blacken(root: Path, *frames: int) -> None:
    """As with a cover on both lenses."""
    for frame in frames:
        for eye in root.rglob(f"image_*/{frame:06d}.png"):
            eye.write_bytes(encode_png(np.zeros((128, 320, 3), np.uint8)))


def test_dark_pairs_are_bridged_and_in_no_map(root: Path, capsys):
    blacken(root, 3)
    more = ("--odometry", "vision", "--to", "npz,mcap", "--frame-clouds", "npz")
    code, answer = told(capsys, root, *more, "--map.points.sigma", "1")
    path = answer["trajectory"]
    assert (code, answer["skipped"], path["frames"]) == (0, 0, 6)
    assert (path["extrapolated"], path["lost"]) == (["000003"], [])
    assert path["frames_judged"] == 5
    assert path["ape_rmse_m"] < 0.05
    out = root.parent / "out"
    assert "black, covered, or without texture" in (out / "report.html").read_text()
    clouds = {file.stem for file in (out / "frames").iterdir()}
    assert "000003" not in clouds
    assert len(clouds) > 1
    (recording,) = out.glob("*.mcap")
    with recording.open("rb") as file:
        read = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        notes = [m.message for _, c, _, m in read if c.topic == "/log"]
    assert len([note for note in notes if note.startswith("pose extrapolated")]) == 1


def test_scans_carry_on_through_the_dark(root: Path, capsys):
    blacken(root, 2, 3)
    code, answer = told(capsys, root)
    path = answer["trajectory"]
    assert (code, path["frames"], path["extrapolated"], path["lost"]) == (0, 6, [], [])
    assert path["by_sensors"] == {"vision": 1, "vision and scan": 3, "scan": 2}
    assert path["ape_rmse_m"] < 0.02
    rows = list(csv.DictReader((root.parent / "out" / "frames.csv").open()))
    assert [row["frame"] for row in rows if row["sensors"] == "scan"] == ["000002", "000003"]


def test_too_long_in_the_dark_ends_the_path_and_says_so(root: Path, capsys):
    blacken(root, 2, 3)
    more = ("--odometry", "vision", "--odometry.visual.reach", "1")
    code, answer = told(capsys, root, *more)
    path = answer["trajectory"]
    assert (code, path["pieces"]) == (4, 2)
    assert path["lost"] == ["000002", "000003"]
    assert path["extrapolated"] == []
    (ended,) = path["ended"]
    assert (ended["code"], ended["where"]) == ("OdometryLost", "frame 000001")
    assert main(["map", str(root), str(root.parent / "out"), "--to", "none", *more]) == 4
    assert "OdometryLost: frame 000001: the path ends here" in capsys.readouterr().out


def test_a_sequence_in_which_nothing_is_seen_is_refused(root: Path, capsys):
    blacken(root, *range(6))
    code, answer = told(capsys, root, "--odometry", "vision", "--no-check")
    assert (code, answer["error"]["code"]) == (3, "OdometryLost")
    assert "none of 6 frames" in answer["error"]["got"]


def placed(root: Path) -> list[str]:
    """Ids of frames that have a pose."""
    times, _ = read_tum_trajectory(root.parent / "out" / "trajectory.tum")
    return [f"{round((time / 1e9 - 1) * RATE_HZ):06d}" for time in times]
