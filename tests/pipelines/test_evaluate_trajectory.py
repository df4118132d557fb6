"""`evaluate trajectory` from the command line: known answers, sources as references, bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.euroc_poses import write_euroc_trajectory
from pseudolidar.formats.timestamps import write_times
from pseudolidar.formats.trajectory import camera_poses, write_kitti_poses
from pseudolidar.formats.tum import write_tum_trajectory
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.running.pose_reading import read_poses
from pseudolidar.sources.synthetic import Synthetic
from tests.evaluation.trajectory.paths import drifting, stamps, winding

# Of the README of the real data.
KNOWN = {
    "ORB": {"rmse": 1.30344971, "mean": 1.1569971, "max": 3.5879491, "rpe": 0.22626134},
    "SPTAM": {"rmse": 3.73848791, "rpe": 0.27607109},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """One drifting path and its truth, in every form."""
    folder = tmp_path_factory.mktemp("paths")
    truth = winding(150)
    for name, poses in (("truth", truth), ("estimate", drifting(truth))):
        write_tum_trajectory(folder / f"{name}.tum", stamps(150), poses)
        write_euroc_trajectory(folder / f"{name}.csv", stamps(150), poses)
        write_kitti_poses(folder / f"{name}.txt", poses)
    return folder


def evaluate(capsys, estimate: Path, *args: object) -> tuple[int, dict, str]:
    code = main(["evaluate", "trajectory", str(estimate), *map(str, args), "--json"])
    told = capsys.readouterr()
    return code, json.loads(told.out), told.err


@pytest.mark.real
@pytest.mark.parametrize("name", KNOWN)
def test_known_answers(real_data, capsys, name):
    estimate = real_data / "trajectories" / f"KITTI_00_{name}.txt"
    reference = real_data / "trajectories" / "KITTI_00_gt.txt"
    code, found, _ = evaluate(capsys, estimate, "--reference", reference)
    known = dict(KNOWN[name])
    # Of a program whose first motion begins at the first pose that is 10 m on.
    over_10_m = found["rpe"]["by_step"][1]["without_first"]
    assert code == 0
    assert over_10_m["rmse_m"] == pytest.approx(known.pop("rpe"), abs=1e-8)
    for statistic, value in known.items():
        assert found["ape"][f"{statistic}_m"] == pytest.approx(value, abs=1e-6)
    assert found["kitti"]["segments_m"] == [100, 200, 300, 400, 500, 600, 700, 800]
    assert found["kitti"]["n"] > 3000
    assert found["turn_sigma_deg"] < 1.1
    assert not any("straight" in note for note in found["notes"])


@pytest.mark.parametrize("estimate", ["estimate.tum", "estimate.csv", "estimate.txt"])
def test_every_form_says_the_same(folder, capsys, estimate):
    code, found, _ = evaluate(capsys, folder / estimate, "--reference", folder / "truth.csv")
    _, plain, _ = evaluate(capsys, folder / "estimate.txt", "--reference", folder / "truth.txt")
    assert code == 0
    assert found["frames"] == 150
    for part, names in (("ape", ("rmse_m", "max_deg")), ("kitti", ("t_rel", "r_rel_deg_per_m"))):
        for name in names:
            assert found[part][name] == pytest.approx(plain[part][name], rel=1e-9)
            assert found[part][name] > 0


def test_a_page_is_written_once(folder, tmp_path, capsys):
    args = ("--reference", folder / "truth.tum", "--report", tmp_path / "a" / "page.html")
    code, found, _ = evaluate(capsys, folder / "estimate.tum", *args, "--align", "sim3")
    page = (tmp_path / "a" / "page.html").read_text()
    assert (code, found["files"]) == (0, [str(tmp_path / "a" / "page.html")])
    assert page.count("image/svg+xml") == 3
    figure = f"{found['ape']['rmse_m']:.3f} m"
    for word in ("across z", "100-800 m", figure, "motion and a scale"):
        assert word in page
    code, found, _ = evaluate(capsys, folder / "estimate.tum", *args)
    assert (code, found["error"]["code"]) == (2, "UsageError")
    code, _, _ = evaluate(capsys, folder / "estimate.tum", *args, "--overwrite")
    assert code == 0
    before = (folder / "truth.tum").read_bytes()
    args = ("--reference", folder / "truth.tum", "--report", folder / "truth.tum", "--overwrite")
    code, found, _ = evaluate(capsys, folder / "estimate.tum", *args)
    assert (code, found["error"]["got"]) == (2, "a file that is no page (HTML)")
    assert (folder / "truth.tum").read_bytes() == before


@pytest.mark.parametrize(
    ("path", "body", "vertical"),
    [
        ("truth.txt", "base_link", 1),
        ("truth.tum", "camera_left", None),
        ("synthetic:flight:3", "camera_left", 1),
        ("synthetic:flight:3", "base_link", 2),
    ],
)
def test_which_axis_stands_upright_is_known_of_some(folder, path, body, vertical):
    place = Path(path) if ":" in path else folder / path
    assert read_poses(place, body=body, times=None).vertical == vertical


def test_a_source_is_a_reference(tmp_path, capsys):
    world = Synthetic("flight", frames=40).open()
    T_base_left = left_in_base_link(world.rig)
    poses = tuple(world.pose(index) for index in range(40))
    write_kitti_poses(tmp_path / "00.txt", camera_poses(poses, T_base_left))
    write_times(tmp_path / "times.txt", [t - 10**9 for t in world.timestamps_ns])
    write_tum_trajectory(
        tmp_path / "body.txt", world.timestamps_ns, np.array([pose.matrix for pose in poses])
    )
    for name in ("00.txt", "body.txt"):
        args = ("--reference", "synthetic:flight:40", "--align", "none")
        code, found, _ = evaluate(capsys, tmp_path / name, *args)
        assert (code, found["frames"], found["reference"]["form"]) == (0, 40, "frames")
        assert found["ape"]["max_m"] < 1e-6
        assert found["length_m"] > 10


@pytest.mark.real
def test_real_drives_are_references(real_data, capsys):
    odometry = real_data / "kitti_odometry"
    poses = odometry / "poses" / "06.txt"
    code, found, _ = evaluate(capsys, poses, "--reference", odometry, "--align", "none")
    assert (code, found["frames"], found["kitti"]["segments_m"]) == (0, 51, [10, 20, 30, 40])
    assert found["ape"]["max_m"] < 1e-9
    assert found["length_m"] == pytest.approx(59.9, abs=0.05)
    drive = real_data / "kitti_raw" / "2011_09_26"
    code, found, _ = evaluate(capsys, drive, "--reference", drive, "--body", "camera_left")
    assert (code, found["frames"], found["ape"]["max_m"] < 1) == (0, 10, True)
    assert found["length_m"] == pytest.approx(8.2, abs=0.1)


@pytest.mark.parametrize(
    ("rows", "args", "code", "where"),
    [
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 nan", (), "PoseFileError", "line 2, column 15"),
        ("not a trajectory", (), "PoseFileError", "line 1"),
        ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1", (), "SequenceTime", "line 2"),
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1", (), "SequenceTime", None),
        ("1 0 0 0 0 1 0 0 0 0 1 0", (), "PoseFileError", "pose 2"),
        ("1 0 0 0 0 0 0 1", ("--times", "none.txt"), "SequenceTime", None),
        ("1 0 0 0 0 0 0 1", ("--rpe", "much"), "UsageError", None),
        ("1 0 0 0 0 0 0 1", ("--segments", "5km"), "UsageError", None),
    ],
)
def test_bad_input_is_refused_by_its_place(folder, tmp_path, capsys, rows, args, code, where):
    (tmp_path / "bad.txt").write_text(rows + "\n")
    status, found, _ = evaluate(
        capsys, tmp_path / "bad.txt", "--reference", folder / "truth.tum", *args
    )
    error = found["error"]
    assert (error["code"], status) == (code, 2 if code == "UsageError" else 3)
    if where is not None:
        assert error["where"] == where
    assert error["want"]


def test_what_is_no_trajectory_is_refused(folder, capsys):
    estimate = folder / "estimate.tum"
    assert evaluate(capsys, estimate)[1]["error"]["code"] == "ReferenceMissing"
    missing = evaluate(capsys, estimate, "--reference", folder / "truth.tun")[1]["error"]
    assert (missing["code"], "truth.tum" in missing["fix"]) == ("SourceUnknown", True)
    assert main(["evaluate", "disparity", str(estimate), "--json"]) == 2
    assert "evaluate trajectory" in json.loads(capsys.readouterr().out)["error"]["fix"]


def test_a_line_is_told_to_leave_a_turn_open(tmp_path, capsys):
    line = np.tile(np.eye(4), (20, 1, 1))
    line[:, 0, 3] = np.arange(20)
    write_kitti_poses(tmp_path / "a.txt", line)
    code, found, _ = evaluate(capsys, tmp_path / "a.txt", "--reference", tmp_path / "a.txt")
    assert code == 0
    assert any("straight line" in note for note in found["notes"])


def test_a_path_that_is_nearly_a_line_tells_how_open_its_turn_is(tmp_path, capsys):
    """Five centimetres from the line, and what is off is half of that."""
    truth = np.tile(np.eye(4), (40, 1, 1))
    truth[:, 0, 3] = np.arange(40)
    truth[:, 1, 3] = 0.05 * np.sin(np.arange(40) / 3)
    estimate = truth.copy()
    estimate[:, 2, 3] = 0.025 * np.sin(np.arange(40) / 5)
    for name, poses in (("truth", truth), ("estimate", estimate)):
        write_kitti_poses(tmp_path / f"{name}.txt", poses)
    args = (tmp_path / "estimate.txt", "--reference", tmp_path / "truth.txt")
    code, found, _ = evaluate(capsys, *args, "--report", tmp_path / "page.html")
    assert code == 0
    assert 10 < found["turn_sigma_deg"] < 40
    assert found["ape"]["rmse_deg"] < 2 * found["turn_sigma_deg"]
    (note,) = (note for note in found["notes"] if "nearly straight" in note)
    assert f"a turn of {found['turn_sigma_deg']:.1f} deg about it open" in note
    assert "a turn about the path is open" in (tmp_path / "page.html").read_text()
    assert main(["evaluate", "trajectory", *map(str, args)]) == 0
    assert f"note: {note}" in capsys.readouterr().out
    _, found, _ = evaluate(capsys, *args, "--align", "origin")
    assert found["turn_sigma_deg"] is None
    assert not any("straight" in note for note in found["notes"])
