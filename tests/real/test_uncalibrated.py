"""Real pairs whose rig is withheld: rows as with it, shape up to a projectivity, scale by one."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pseudolidar.calibration.check_matches import PairMatches, match_points
from pseudolidar.calibration.known_distance import KnownDistance, said_scale, scaled_rig
from pseudolidar.calibration.uncalibrated import fit_uncalibrated
from pseudolidar.cli import main
from pseudolidar.formats.rigs.rig_json import read_rig
from pseudolidar.sources.kitti.raw import KittiRaw
from tests.calibration.test_uncalibrated import hartley_rows_px, placed, projective_residual
from tests.stereo.motorcycle import motorcycle

pytestmark = pytest.mark.real
# Row difference that OpenCV finds acceptable after a board: 0.25 px. Median of all that agree.
ROWS_PX = 0.25


@pytest.fixture(scope="module")
def kitti(real_data):
    """Matches of three pairs, and their true rig."""
    source = KittiRaw(str(real_data / "kitti_raw")).open()
    frames = [source.load(index) for index in (0, 4, 8)]
    return [match_points(frame.left, frame.right) for frame in frames], source.rig


def true_places(matches, rig):
    ones = np.ones(len(matches))
    columns = np.column_stack([matches.left_px, matches.disparity_px, ones])
    return columns @ rig.Q.T


def agreeing(matches, rig):
    good = np.abs(matches.row_difference_px) < 1
    return matches.selected(good & (matches.disparity_px + rig.doffs_px > 1.0))


@pytest.mark.parametrize("focal", ["given", "unknown"])
@pytest.mark.parametrize("name", ["kitti", "motorcycle"])
def test_rows_and_shape_without_the_rig(real_data, kitti, name, focal):
    if name == "kitti":
        pairs, rig = kitti
    else:
        frame = motorcycle(real_data)
        pairs, rig = [match_points(frame.left, frame.right)], frame.rig
    fit = fit_uncalibrated(pairs, focal_px=rig.left.focal_px if focal == "given" else None)
    assert fit.after_px < ROWS_PX
    assert fit.held_px < ROWS_PX
    columns = [np.concatenate([getattr(m, eye) for m in pairs]) for eye in ("left_px", "right_px")]
    assert fit.after_px <= 1.05 * hartley_rows_px(PairMatches(*columns, pairs[0].size_px))
    seen = [agreeing(matches, rig) for matches in pairs]
    true = np.concatenate([true_places(matches, rig) for matches in seen])
    found = np.concatenate([placed(fit, matches)[0] for matches in seen])
    assert projective_residual(found, true) < 0.01


def test_kitti_in_metres_by_its_baseline(kitti):
    """With focal length and baseline known, near depths are those of the rig."""
    pairs, rig = kitti
    fit = fit_uncalibrated(pairs, focal_px=rig.left.focal_px)
    known = KnownDistance("baseline", rig.baseline_m)
    metric = scaled_rig(fit.rig, said_scale(known, fit.rig))
    seen = [agreeing(matches, rig) for matches in pairs]
    true = np.concatenate([true_places(matches, rig) for matches in seen])
    homogeneous = np.concatenate([placed(fit, matches)[0] for matches in seen])
    ratio = np.linalg.norm(metric.T_right_left.translation_m) / np.linalg.norm(
        fit.rig.T_right_left.translation_m
    )
    lengths = np.linalg.norm(homogeneous[:, :3] / homogeneous[:, 3:], axis=1) * ratio
    wanted = np.linalg.norm(true[:, :3] / true[:, 3:], axis=1)
    near = wanted < 20
    assert np.median(np.abs(lengths[near] / wanted[near] - 1)) < 0.05


def test_chessboard_pictures_without_a_board(real_data, tmp_path, capsys):
    """From 12 px to what a board gives: 0.25 px; the folder is taken by convert, not as metres."""
    folder = next((real_data / "chessboard").glob("pinhole*"))
    out = tmp_path / "flat"
    assert main(["rectify", str(folder), str(out), "--uncalibrated", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["uncalibrated"]["rows_before_px"] > 10
    assert found["uncalibrated"]["rows_after_px"] < ROWS_PX
    assert found["row_difference_px"] < ROWS_PX
    assert found["uncalibrated"]["metric"] is False
    assert not read_rig(out / "rig.json").metric
    assert not read_rig(out / "cameras.json").is_rectified
    call = ["convert", str(out), str(tmp_path / "clouds"), "--to", "ply", "--frames", "0:2"]
    assert main(call) == 0
    said = capsys.readouterr()
    assert "scale unknown" in said.out + said.err


def rectified(capsys, folder, out, *flags):
    assert main(["rectify", str(folder), str(out), "--uncalibrated", *flags, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_exchanged_pictures_of_a_board_are_named_and_then_done(real_data, tmp_path, capsys):
    """One of the pairs is a board whose squares are taken for each other: it stops nothing."""
    folder = real_data / "chessboard" / "swapped_640x512"
    assert main(["rectify", str(folder), str(tmp_path / "no"), "--uncalibrated", "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "PairSwapped"
    told = rectified(capsys, folder, tmp_path / "out", "--swap", "--frames", "01,13,25")
    assert told["row_difference_px"] < ROWS_PX
    assert told["bent"] is False


def test_fisheyes_are_said_to_need_a_board(real_data, tmp_path, capsys):
    """Two matches of three agree on a flat picture, and all the others are off."""
    folder = next((real_data / "chessboard").glob("fisheye*"))
    told = rectified(capsys, folder, tmp_path / "out", "--frames", "29")
    assert told["bent"] is True
    assert told["row_difference_px"] > 1
    assert told["uncalibrated"]["rows_left_out_px"] < ROWS_PX


def test_a_known_distance_says_how_little_it_tells(real_data, tmp_path, capsys):
    """The centres of Middlebury's pictures are off the middle by 59 and 28 px."""
    frame = motorcycle(real_data)
    true_m = frame.rig.fB_px_m / (frame.truth.values[282:299, 592:609] + frame.rig.doffs_px)
    known = f"box:592,282,608,298={np.nanmedian(true_m):.4f}"
    flags = ("--focal", f"{frame.rig.left.focal_px}", "--known-distance", known)
    told = rectified(capsys, real_data / "middlebury" / "motorcycle", tmp_path / "out", *flags)
    share = told["uncalibrated"]["scale_sigma"]
    off = read_rig(tmp_path / "out" / "rig.json").baseline_m / frame.rig.baseline_m - 1
    assert 0.1 < abs(off) < 2 * share
    assert share < 0.5
