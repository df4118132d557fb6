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
