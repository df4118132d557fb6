"""Chessboards that others took: pinhole, exchanged eyes, fisheye."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.boards.board import Board, BoardName
from pseudolidar.calibration.boards.seen import FindInPair
from pseudolidar.cli import main
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.rigs.rig_json import read_rig
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import rectification
from pseudolidar.sources.bare_films import recognise_bare

pytestmark = pytest.mark.real
PINHOLE, SWAPPED = "pinhole_640x360_square_0.02423m", "swapped_640x512"
FISHEYE = "fisheye_960x600_square_0.02423m"
SQUARE_M = "0.02423"
# Depths of the board against its own geometry, and how much of it has one; of all 83 views the
# medians are 0.3, 0.4 and 0.5 % and 94, 86 and 79 %.
DEPTH_REL, DENSITY = 0.01, 0.75


@pytest.fixture(scope="module")
def calibrated(real_data, tmp_path_factory):
    """What `calibrate` says of a set, which it looks at once."""

    @functools.cache
    def told(name: str) -> dict:
        out = tmp_path_factory.mktemp("calibrated") / "rig.json"
        folder = str(real_data / "chessboard" / name)
        call = ["calibrate", folder, "--board", "chessboard:9x6", "--square", SQUARE_M]
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            assert main([*call, "--out", str(out), "--json"]) == 0
        return json.loads(printed.getvalue())

    return told


def test_pinhole_cameras(calibrated):
    told = calibrated(PINHOLE)
    assert told["model"] == "pinhole"
    assert told["rms_stereo"] <= 0.24
    assert max(told["rms_left"], told["rms_right"]) <= 0.15
    assert told["baseline_m"] == pytest.approx(0.094, abs=0.001)
    assert told["holdout_row_error_px"] <= 0.21
    assert (told["views_used"], told["swapped"]) == (29, False)


def test_exchanged_eyes(calibrated):
    told = calibrated(SWAPPED)
    assert told["swapped"]
    assert told["rms_stereo"] <= 0.17
    assert told["holdout_row_error_px"] <= 0.12
    assert told["verdict"] == "good"


def test_fisheye_cameras(calibrated):
    told = calibrated(FISHEYE)
    assert told["model"] == "fisheye"
    assert told["rms_stereo"] <= 0.31
    assert max(told["rms_left"], told["rms_right"]) <= 0.19
    assert told["baseline_m"] == pytest.approx(0.111, abs=0.001)
    assert all("eyes disagree" in view["reason"] for view in told["dropped"])
    assert told["views_used"] >= 22


@pytest.mark.parametrize(("name", "view"), [(PINHOLE, "13"), (SWAPPED, "04"), (FISHEYE, "12")])
def test_two_commands_give_metres(calibrated, tmp_path, name, view):
    """The board where it is, by the command that `calibrate` ends with; views held near, or small.

    Without a nearest depth of the rig, or with boards taken for speckles, no point of it is left.
    """
    told = calibrated(name)
    call = shlex.split(told["command"])[1:]
    call[call.index("clouds")] = str(tmp_path / "clouds")
    assert main([*call, "--frames", view, "--to", "npz"]) == 0
    errors, density = board_in(tmp_path / "clouds" / "npz" / f"{view}.npz", told, view)
    assert abs(np.median(errors)) < DEPTH_REL
    assert np.median(np.abs(errors)) < DEPTH_REL
    assert density > DENSITY


def board_in(file: Path, told: dict, view: str) -> tuple[np.ndarray, float]:
    """Relative errors of the depths of a board's points, and the share of its pixels with one."""
    plan = rectification(read_rig(Path(told["out"])))
    board = Board.of(BoardName.parse("chessboard:9x6"), float(SQUARE_M))
    pairs = recognise_bare(told["path"]).open()
    pair = pairs.load(pairs.ids.index(view))
    seen = FindInPair(board)(pair.left, pair.right, view)
    corners = seen.right if told["swapped"] else seen.left
    directions = Lens.of(plan.raw.left).nearest_directions(corners.uv) @ plan.R_left.T
    ahead = directions[:, :2] / directions[:, 2:]
    at_m = board.points_m[corners.ids]
    _, turn, shift = cv2.solvePnP(at_m, ahead, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(at_m, ahead, np.eye(3), None, turn, shift)
    normal = cv2.Rodrigues(turn)[0][:, 2]
    K, (width, height) = plan.rig.left.K, plan.rig.left.size_px
    outline = at_m[[0, 8, 53, 45]]
    quad = cv2.projectPoints(outline, turn, shift, K, None)[0].reshape(-1, 2)
    inside = cv2.fillConvexPoly(np.zeros((height, width), np.uint8), np.rint(quad).astype(int), 1)
    cloud = read_npz(file)
    u, v = np.rint(cloud.uv).astype(int).T
    on_board = inside[v, u] > 0
    rays = np.column_stack([cloud.uv, np.ones(len(cloud))]) @ np.linalg.inv(K).T
    true_m = (normal @ shift[:, 0]) / (rays[on_board] @ normal)
    return cloud.xyz[on_board, 2] / true_m - 1, float(on_board.sum() / inside.sum())
