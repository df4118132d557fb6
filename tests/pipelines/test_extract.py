"""An unsynchronised drive from its folder to metres: an eye turned, found, mended, converted."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.geometry.rectification import rectification
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.pose import Pose
from tests.extract_drives import DATE, DRIVE, stamps, write_calibration, write_pictures
from tests.lens_worlds import raw_pair, true_depth, world_rig

FRAMES = 3
TURN_DEG = (0.25, 0.0, -0.3)


def five(camera):
    return replace(camera, distortion=np.pad(camera.distortion[:5], (0, 0)))


@pytest.fixture(scope="module")
def rigs():
    """The rig of the calibration, and the one whose right eye was bumped since."""
    said = world_rig("pinhole", (400, 300), focal_px=260.0)
    said = replace(said, left=five(said.left), right=five(said.right))
    R_right = rectification(said).R_right
    bump = np.eye(4)
    turn = exp_twist(np.concatenate([np.zeros(3), np.radians(TURN_DEG)]))[:3, :3]
    bump[:3, :3] = R_right.T @ turn @ R_right
    pose = said.T_right_left
    return said, replace(said, T_right_left=Pose(pose.dst, pose.src, bump @ pose.matrix))


@pytest.fixture(scope="module")
def drive(rigs, tmp_path_factory):
    said, bumped = rigs
    folder = tmp_path_factory.mktemp("extract") / DATE / DRIVE
    pairs = [raw_pair(bumped, 0.4 * n, index=n) for n in range(FRAMES)]
    write_calibration(folder.parent, said)
    write_pictures(folder, 0, [pair.left for pair in pairs], stamps(FRAMES))
    write_pictures(folder, 1, [pair.right for pair in pairs], stamps(FRAMES))
    return folder


@pytest.fixture(scope="module")
def mended(drive, tmp_path_factory):
    out = tmp_path_factory.mktemp("mended") / "rig.json"
    assert main(["check", str(drive), "--frames", "0::1", "--out", str(out)]) in (0, 3)
    return out


def findings(capsys, *call):
    capsys.readouterr()
    main(["check", *map(str, call), "--frames", "0::1", "--json"])
    return {f["name"]: f for f in json.loads(capsys.readouterr().out)["findings"]}


def test_the_turn_is_found_and_the_mended_rig_is_the_true_one(drive, rigs, mended, capsys):
    before = findings(capsys, drive)
    turn = before["rotation"]
    for name, degrees in zip(("pitch", "yaw", "roll"), TURN_DEG, strict=True):
        assert abs(turn[f"{name}_deg"] - degrees) < 3 * turn[f"{name}_sigma_deg"]
    assert turn["rows_before_px"] > 1.0
    assert before["rows"]["severity"] == "stop"
    after = findings(capsys, drive, "--rig", mended)
    assert after["rows"]["severity"] == "good"
    assert after["rotation"]["severity"] == "good"
    assert after["rotation"]["rows_before_px"] < 0.1
    said, bumped = rigs
    got = read_rig(mended).T_right_left.matrix
    assert np.abs(got - bumped.T_right_left.matrix).max() < 0.1 * np.abs(
        said.T_right_left.matrix - bumped.T_right_left.matrix
    ).max() + np.radians(0.01)


def test_metres_come_out_of_the_mended_drive(drive, mended, tmp_path):
    out = tmp_path / "out"
    call = ["convert", str(drive), str(out), "--frame", "camera_left", "--to", "npz"]
    assert main([*call, "--rig", str(mended), "--frames", "0"]) == 0
    cloud = read_cloud(out / "npz" / "0000000000.npz")
    truth = true_depth(rectification(read_rig(mended)))
    u, v = np.rint(cloud.uv).astype(int).T
    off = np.abs(cloud.xyz[:, 2] / truth[v, u] - 1)
    assert np.nanmedian(off) < 0.01
    assert len(cloud) > 0.5 * truth.size


def test_refined_rows_are_kept_with_the_mounted_cameras(drive, mended, tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert (
        main(["refine", str(drive), "--by", "rows", "--rig", str(mended), "--out", str(out)]) == 0
    )
    if not out.exists():  # nothing was left to be put right
        assert "nothing to be put right" in capsys.readouterr().out
        return
    rig = read_rig(out)
    assert not rig.is_rectified
    assert rig.rows is not None


def test_a_rig_of_rectified_pictures_is_refused_for_unrectified_ones(drive, rigs, tmp_path, capsys):
    path = tmp_path / "rectified.json"
    write_rig(path, rectification(rigs[0]).rig)
    assert main(["convert", str(drive), str(tmp_path / "out"), "--rig", str(path), "--json"]) == 3
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "NotRectified"
    assert "check SOURCE --out" in error["fix"]
    small = rigs[0].scaled_to(320, 240)
    write_rig(tmp_path / "small.json", small)
    call = ["check", str(drive), "--rig", str(tmp_path / "small.json"), "--frames", "0"]
    assert main([*call, "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "CalibrationSizeMismatch"
    capsys.readouterr()
    main([*call, "--scale-calibration", "--json"])
    assert "findings" in json.loads(capsys.readouterr().out)
