"""`pseudolidar refine` without a LiDAR: files, report, refusals."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.rows import Rows
from pseudolidar.cli import main
from pseudolidar.errors import CalibrationValue
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.running.motion_refining import LookAt
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.structures.correction import RowCorrection

OFFSET_PX = -0.4
TILT = RowCorrection(np.array([0.0, 0, 0, 0, 2.0, 0, 0, 0, 0]), 0.0)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A flight whose right camera is turned and rolled a little, as a folder of pairs."""
    folder = tmp_path_factory.mktemp("flight")
    source = Synthetic("flight", frames=11, seed=5, width_px=480).open()
    width, height = source.rig.left.size_px
    v, u = np.indices((height, width)).astype(np.float32)
    x = (u - source.rig.left.K[0, 2]) / source.rig.left.K[0, 0]
    # What row v shows comes to row v + offset, so it is looked for at v - offset.
    fields = u + OFFSET_PX * (1 + x * x), v - TILT.offset_px(u, v, (width, height))
    fields = tuple(field.astype(np.float32) for field in fields)
    for eye in ("left", "right"):
        (folder / eye).mkdir()
    for index, name in enumerate(source.ids):
        frame = source.load(index)
        right = cv2.remap(frame.right, *fields, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        (folder / "left" / f"{name}.png").write_bytes(encode_png(frame.left))
        (folder / "right" / f"{name}.png").write_bytes(encode_png(right))
    write_rig(folder / "rig.json", source.rig)
    return folder


@pytest.fixture(scope="module")
def refined(flight, tmp_path_factory):
    return tmp_path_factory.mktemp("refined") / "new.json"


def told(capsys, *arguments, status=0):
    assert main([str(each) for each in arguments]) == status
    return json.loads(capsys.readouterr().out)


def test_motion_and_rows_end_in_the_rig_file(flight, refined, capsys):
    report = told(capsys, "refine", flight, "--by", "motion", "--out", refined, "--json")
    assert report["out"] == str(refined)
    motion, rows = report["motion"], report["rows"]
    assert motion["offset_px"] == pytest.approx(OFFSET_PX, abs=0.06)
    assert abs(motion["offset_px"] - OFFSET_PX) < 2 * motion["sigma_px"]
    assert motion["scale_seen"] is False
    assert rows["corrected"]
    assert rows["after_px"] < 0.6 * rows["before_px"]
    assert rows["density_after"] > rows["density_before"]
    rig = read_rig(refined)
    assert rig.rows.coefficients[4] == pytest.approx(2.0, abs=0.2)
    # nobody surveyed the flight, so near depths stay as calibrated
    assert motion["scale_by"] == "near"
    assert rig.correction.coefficients[0] * motion["scale_factor"] == pytest.approx(
        motion["offset_px"], abs=0.02
    )
    assert rig.correction.coefficients[1] > 0.1
    assert rig.correction.residual_px > 0.5
    assert "motion of 11 frames" in rig.correction.origin


def test_poses_of_the_source_tell_a_wrong_baseline(tmp_path, capsys):
    arguments = ["synthetic:flight:10", "--source.width-px", 400, "--matcher", "census:fast"]
    rig = Synthetic("flight", frames=1, width_px=400).open().rig
    matrix = rig.T_right_left.matrix.copy()
    matrix[0, 3] *= 1.04
    longer = replace(rig, T_right_left=replace(rig.T_right_left, matrix=matrix))
    write_rig(tmp_path / "wrong.json", longer)
    out = tmp_path / "rig.json"
    arguments += ["--rig", tmp_path / "wrong.json", "--by", "motion", "--out", out]
    report = told(capsys, "refine", *arguments, "--json")["motion"]
    assert (report["scale_by"], report["scale_seen"]) == ("poses", True)
    assert report["scale_sigma_rel"] < 0.02  # a third of KITTI's width
    assert abs(report["scale_factor"] - 1 / 1.04) < 1.5 * report["scale_sigma_rel"]
    correction = read_rig(out).correction
    assert correction.coefficients[1] == pytest.approx(50 * (1 - 1 / report["scale_factor"]))
    assert 0.2 <= correction.residual_px < 0.5


def test_the_rig_is_used_and_told_of(flight, refined, capsys, tmp_path):
    if not refined.exists():
        assert main(["refine", str(flight), "--by", "motion", "--out", str(refined)]) == 0
    out = tmp_path / "clouds"
    arguments = ["convert", flight, out, "--rig", refined, "--frames", "0:1", "--workers", "1"]
    assert main([str(each) for each in arguments]) == 0
    assert "rows of right pictures put right" in capsys.readouterr().err
    # Fitted again on top of itself nothing changes: pictures are taken as they are.
    again = told(capsys, "refine", flight, "--rig", refined, "--by", "rows",
                 "--out", tmp_path / "again.json", "--json")  # fmt: skip
    assert again["replaced"] is True
    mine, theirs = read_rig(tmp_path / "again.json"), read_rig(refined)
    assert np.allclose(mine.rows.coefficients, theirs.rows.coefficients, atol=0.02)
    assert np.array_equal(mine.correction.coefficients, theirs.correction.coefficients)


def test_text_says_what_cannot_be_seen(flight, tmp_path, capsys):
    assert main(["refine", str(flight), "--by", "motion", "--out", str(tmp_path / "rig.json")]) == 0
    text = capsys.readouterr().out
    assert "scale f B cannot be seen" in text
    assert "judged on frames left out" in text
    assert f"{tmp_path / 'rig.json'}: pass it to other commands with --rig" in text


def test_no_file_where_motion_tells_nothing(flight, tmp_path, capsys):
    out = tmp_path / "rig.json"
    error = told(
        capsys,
        "refine",
        flight,
        "--by",
        "motion",
        "--out",
        out,
        "--frames",
        "0:5",
        "--json",
        status=3,
    )["error"]
    assert error["code"] == "MotionInsufficient"
    assert "9 or more" in error["want"]
    assert not out.exists()


def test_no_file_where_there_is_nothing_to_put_right(tmp_path, capsys):
    arguments = ("synthetic:street:4", "--source.width-px", 480, "--by", "rows")
    report = told(capsys, "refine", *arguments, "--out", tmp_path / "rig.json", "--json")
    assert report["out"] is None
    assert not (tmp_path / "rig.json").exists()
    assert "nothing to be gained" in report["rows"]["reason"]


def test_exchanged_eyes_stop_it(flight, tmp_path, capsys):
    out = tmp_path / "rig.json"
    error = told(capsys, "refine", flight, "--swap", "--out", out, "--json", status=3)["error"]
    assert error["code"] == "PairSwapped"
    assert not out.exists()


def test_a_file_is_not_written_over_unasked(flight, tmp_path, capsys):
    out = tmp_path / "rig.json"
    out.write_text("mine")
    error = told(capsys, "refine", flight, "--by", "motion", "--out", out, "--json", status=2)[
        "error"
    ]
    assert "--overwrite" in error["fix"]
    assert out.read_text() == "mine"


def test_frames_of_another_rig_are_left_out():
    frame = Synthetic("street", frames=1, width_px=320).open().load(0)
    wider = np.array([[1.01], [1], [1]])
    left, right = (replace(eye, K=eye.K * wider) for eye in (frame.rig.left, frame.rig.right))
    other = replace(frame.rig, left=left, right=right)
    look = LookAt(frame.rig, Census().load(), False, frozenset(Rows().needed(1)))
    assert look(frame).points is not None
    with pytest.raises(CalibrationValue, match="another rig"):
        look(replace(frame, rig=other))
