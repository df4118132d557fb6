"""`pseudolidar refine` by scans and ground truth: rigs of rendered worlds that are wrong."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.evaluation.compared import against_truth
from pseudolidar.evaluation.ranges import errors_by_range
from pseudolidar.formats.rigs.rig_json import read_rig
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.stereo.census import Census

FRAMES = 5
# How wrong the rig is.
LONGER, OFFSET_PX, YAW_DEG = 1.01, 0.3, 0.1


def told(capsys, *arguments, status=0):
    assert main([str(each) for each in arguments]) == status
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    """A street as KITTI stereo data."""
    folder = tmp_path_factory.mktemp("street")
    assert main(["synth", str(folder), "--layout", "stereo", "--frames", str(FRAMES)]) == 0
    return folder / "training"


@pytest.fixture(scope="module")
def drive(exact, tmp_path_factory):
    """The same street with a right camera that is turned."""
    folder = tmp_path_factory.mktemp("turned") / "training"
    shutil.copytree(exact, folder)
    turn = np.radians(YAW_DEG)
    R = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    K = KittiStereo(str(exact)).open().rig.right.K
    for path in (folder / "image_3").iterdir():
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        turned = cv2.warpPerspective(
            picture,
            K @ R @ np.linalg.inv(K),
            picture.shape[1::-1],
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
        assert cv2.imwrite(str(path), turned)
    return folder


@pytest.fixture(scope="module")
def wrong_rig(exact, tmp_path_factory):
    """A baseline that is too long; disparities read too large, by the right centre."""
    path = tmp_path_factory.mktemp("rig") / "wrong.json"
    rig = KittiStereo(str(exact)).open().rig
    K = rig.left.K
    path.write_text(
        json.dumps(
            {
                "schema": 1,
                "width_px": rig.left.width_px,
                "height_px": rig.left.height_px,
                "baseline_m": LONGER * rig.baseline_m,
                "left": {"fx": K[0, 0], "cx": K[0, 2], "cy": K[1, 2]},
                "right": {"fx": K[0, 0], "cx": K[0, 2] - OFFSET_PX, "cy": K[1, 2]},
            }
        )
    )
    return path


@pytest.fixture(scope="module")
def run(drive, wrong_rig, tmp_path_factory):
    """What the command tells of the wrong rig, and the rig that it writes."""
    out = tmp_path_factory.mktemp("refined") / "rig.json"
    args = ["refine", str(drive), "--rig", str(wrong_rig), "--out", str(out), "--json"]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(args) == 0
    return json.loads(printed.getvalue()), out


@pytest.fixture(scope="module")
def refined(run):
    return run[1]


def bias_by_range(pictures, exact, *rigs):
    """Of the depths that each rig makes of the pictures, against those of the rendered world."""
    taken, rendered = (KittiStereo(str(each)).open() for each in (pictures, exact))
    match = Census(quality="fine").load()
    frames = []
    for index in range(FRAMES):
        frames.append(against_truth(match(taken.load(index)), rendered.load(index), most=50_000))
    true_m = np.concatenate([frame.reference_m for frame in frames])
    for rig in rigs:
        depth_m = np.concatenate([replace(frame, rig=rig).depth_m for frame in frames])
        yield {b.from_m: b.bias_rel for b in errors_by_range(depth_m, true_m) if b.n > 500}


def test_a_wrong_rig_is_mended_to_a_seventh(exact, drive, wrong_rig, refined):
    """In every range, of what the rig adds to the matcher's own bias."""
    (right,) = bias_by_range(exact, exact, KittiStereo(str(exact)).open().rig)
    before, after = bias_by_range(drive, exact, read_rig(wrong_rig), read_rig(refined))
    assert {5, 10, 20, 30, 50} <= set(before)
    for low_m, bias in before.items():
        assert abs(bias - right[low_m]) > 0.009
        assert abs(after[low_m] - right[low_m]) < 0.15 * abs(bias - right[low_m]), low_m


def test_a_wrong_rig_is_diagnosed_by_name(drive, wrong_rig, refined, capsys):
    """All three at once: the baseline, and a yaw that is named as not told apart from an offset."""
    options = ("--matcher", "census:fine", "--json")
    found = told(capsys, "compare", drive, "--rig", wrong_rig, *options)["diagnosis"]
    causes = {cause["cause"]: cause for cause in found["chosen"]["causes"]}
    assert set(causes) == {"scale", "yaw"}
    assert causes["scale"]["size"] == pytest.approx(100 * (LONGER - 1), abs=0.3)
    assert causes["yaw"]["twins"] == ["offset"]
    # an offset of 0.3 px the other way takes 0.024 degrees of the yaw away in the middle
    assert causes["yaw"]["size"] == pytest.approx(YAW_DEG, abs=0.025)
    assert "yaw may as well be offset" in found["text"]
    assert found["chosen"]["explained"] > 0.85
    mended = told(capsys, "compare", drive, "--rig", refined, *options)["diagnosis"]
    assert mended["systematic_px"] < 0.15 * found["systematic_px"]
    assert mended["chosen"]["causes"] == []
    assert "healthy" in mended["text"]


def test_the_report_tells_terms_uncertainty_and_frames_left_out(run):
    report, out = run
    assert report["out"] == str(out)
    assert report["references"] == {"scan": FRAMES}
    assert [c["name"] for c in report["candidates"]][:2] == ["none", "offset"]
    before, after = ({b["from_m"]: b for b in report[when]["bins"]} for when in ("before", "after"))
    assert abs(after[10]["bias_rel"]) < 0.1 * abs(before[10]["bias_rel"])
    correction = read_rig(out).correction
    assert report["correction"]["coefficients"] == correction.coefficients.tolist()
    assert correction.covariance is not None
    assert 0 < correction.residual_px < 0.5
    assert "LiDAR scans of 5 frames" in correction.origin
    assert report["correction"]["fitted_m"] == list(correction.fitted_m)
    near_m, far_m = correction.fitted_m
    assert 4 < near_m < 10 < 30 < far_m < 120
    rig = read_rig(out)
    for each in report["correction"]["systematic_rel"]:
        # Z = fB / d: dZ / Z = Z dd / fB
        expected = each["at_m"] * correction.residual_px / rig.fB_px_m
        assert each["rel"] == pytest.approx(expected, rel=0.01)


def test_later_commands_say_that_the_rig_was_refined(drive, refined, tmp_path, capsys):
    out = tmp_path / "out"
    args = ["convert", drive, out, "--rig", refined, "--frames", "0:1", "--to", "pcd"]
    assert main([str(each) for each in args]) == 0
    assert "refined rig: leaves" in capsys.readouterr().err
    assert "the rig was refined" in (out / "report.html").read_text()


def test_a_rig_that_is_replaced_is_kept(drive, wrong_rig, tmp_path, capsys):
    out, source = tmp_path / "rig.json", ("refine", drive, "--frames", "0:2", "--no-check")
    arguments = [*source, "--rig", wrong_rig, "--out", out]
    assert told(capsys, *arguments, "--json")["previous"] is None
    first = out.read_bytes()
    error = told(capsys, *arguments, "--json", status=2)["error"]
    assert "--overwrite" in error["fix"]
    again = ("--rig", out, "--matcher", "census:fast", "--overwrite", "--json")
    report = told(capsys, *source, "--out", out, *again)
    assert report["replaced"]
    assert report["previous"] == str(tmp_path / "rig.previous.json")
    assert (tmp_path / "rig.previous.json").read_bytes() == first != out.read_bytes()


@pytest.mark.parametrize("content", ["", "notes on the rig", '{"camera": 1}'])
def test_a_file_that_is_no_rig_is_never_replaced(content, drive, tmp_path, capsys):
    out = tmp_path / "notes.json"
    out.write_text(content)
    error = told(capsys, "refine", drive, "--out", out, "--overwrite", "--json", status=2)["error"]
    assert "no rig" in error["got"]
    assert out.read_text() == content


def test_later_commands_say_it_once(drive, refined, capsys):
    args = ["evaluate", "disparity", drive, "--rig", refined, "--frames", "0:1", "--no-check"]
    assert main([str(each) for each in args]) == 0
    assert capsys.readouterr().out.count("the correction of the rig is not used here") == 1
    assert main(["compare", str(drive), *map(str, args[3:])]) == 0
    assert capsys.readouterr().out.count("refined rig: leaves") == 1


def test_ground_truth_disparities_serve_as_well(exact, tmp_path, capsys):
    """They know the pictures' disparities, and nothing of the baseline."""
    arguments = ["refine", exact, "--by", "reference:truth", "--out", tmp_path / "rig.json"]
    report = told(capsys, *arguments, "--json")
    assert report["references"] == {"truth": FRAMES}
    assert abs(report["correction"]["coefficients"][0]) < 0.1
    assert report["before"]["bins"][1]["median_rel"] < 0.02


def test_one_frame_fits_less_and_says_so(drive, wrong_rig, tmp_path, capsys):
    arguments = ["refine", drive, "--rig", wrong_rig, "--frames", "0:1"]
    report = told(capsys, *arguments, "--out", tmp_path / "rig.json", "--json")
    assert report["after"] is None
    assert any("all terms need" in (c["refused"] or "") for c in report["candidates"])


def test_pairs_without_a_reference_are_told_what_to_do(tmp_path, capsys):
    assert main(["synth", str(tmp_path), "--layout", "odometry", "--frames", "2"]) == 0
    sequence = tmp_path / "sequences" / "00"
    for scan in sequence.glob("velodyne/*"):
        scan.unlink()
    capsys.readouterr()
    out = tmp_path / "rig.json"
    error = told(capsys, "refine", tmp_path, "--out", out, "--json", status=3)["error"]
    assert "--by motion" in error["fix"]
    assert not out.exists()


PITCH_DEG = 0.1


@pytest.fixture(scope="module")
def pitched(exact, tmp_path_factory):
    """The street, with a LiDAR that is calibrated as if it looked further down than it does."""
    folder = tmp_path_factory.mktemp("pitched") / "training"
    shutil.copytree(exact, folder)
    c, s = np.cos(np.radians(PITCH_DEG)), np.sin(np.radians(PITCH_DEG))
    down = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    for path in (folder / "calib").iterdir():
        lines = path.read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if line.startswith("Tr:"))
        key, numbers = lines[at].split(":")
        turned = down @ np.array(numbers.split(), float).reshape(3, 4)
        lines[at] = f"{key}: " + " ".join(f"{x:.12g}" for x in turned.ravel())
        path.write_text("\n".join(lines) + "\n")
    return folder


def test_a_lidar_that_looks_too_low_is_found_and_raised(exact, pitched, tmp_path, capsys):
    out = tmp_path / "rig.json"
    source = ("refine", pitched, "--frames", "0:3", "--matcher", "census")
    found = told(capsys, *source, "--out", out, "--json")
    assert found["lidar_pitch_deg"] == pytest.approx(PITCH_DEG, abs=0.02)
    assert 0 < found["lidar_pitch_sigma_deg"] < 0.02
    right = KittiStereo(str(exact)).open().rig.T_left_velodyne
    raised = opened_with_rig(KittiStereo(str(pitched)), out).load(0).rig.T_left_velodyne
    off = raised @ right.inverse()
    assert np.degrees(np.linalg.norm(off.matrix[:3, :3] - np.eye(3)) / np.sqrt(2)) < 0.02
    again = told(capsys, *source, "--rig", out, "--out", tmp_path / "again.json", "--json")
    assert again["out"] is None  # nothing is left to be put right
