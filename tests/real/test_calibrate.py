"""Chessboards that others took: pinhole, exchanged eyes, fisheye."""

from __future__ import annotations

import json

import pytest

from pseudolidar.cli import main

pytestmark = pytest.mark.real
SQUARE_M = "0.02423"


def calibrated(folder, tmp_path, capsys) -> dict:
    out = tmp_path / "rig.json"
    args = ["calibrate", str(folder), "--board", "chessboard:9x6", "--square", SQUARE_M]
    assert main([*args, "--out", str(out), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_pinhole_cameras(real_data, tmp_path, capsys):
    folder = real_data / "chessboard" / "pinhole_640x360_square_0.02423m"
    told = calibrated(folder, tmp_path, capsys)
    assert told["model"] == "pinhole"
    assert told["rms_stereo"] <= 0.24
    assert max(told["rms_left"], told["rms_right"]) <= 0.15
    assert told["baseline_m"] == pytest.approx(0.094, abs=0.001)
    assert told["holdout_row_error_px"] <= 0.21
    assert (told["views_used"], told["swapped"]) == (29, False)


def test_exchanged_eyes(real_data, tmp_path, capsys):
    told = calibrated(real_data / "chessboard" / "swapped_640x512", tmp_path, capsys)
    assert told["swapped"]
    assert told["rms_stereo"] <= 0.17
    assert told["holdout_row_error_px"] <= 0.12
    assert told["verdict"] == "good"


def test_fisheye_cameras(real_data, tmp_path, capsys):
    folder = real_data / "chessboard" / "fisheye_960x600_square_0.02423m"
    told = calibrated(folder, tmp_path, capsys)
    assert told["model"] == "fisheye"
    assert told["rms_stereo"] <= 0.31
    assert max(told["rms_left"], told["rms_right"]) <= 0.19
    assert told["baseline_m"] == pytest.approx(0.111, abs=0.001)
    assert all("eyes disagree" in view["reason"] for view in told["dropped"])
    assert told["views_used"] >= 22
