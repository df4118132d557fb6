"""`rectify --uncalibrated` on a rendered room: what it writes, says, and refuses."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.sources.synthetic import Synthetic
from tests.perturbed import right_turned

FRAMES = 3
TURN_DEG = (1.0, 0.5, -2.0)


@pytest.fixture(scope="module")
def room():
    """The rig of the room and its pairs, the right eye turned."""
    source = Synthetic("room", width_px=480, frames=FRAMES).open()
    return source.rig, [right_turned(source.load(n), TURN_DEG) for n in range(FRAMES)]


@pytest.fixture(scope="module")
def folder(room, tmp_path_factory):
    place = tmp_path_factory.mktemp("bare") / "room"
    for eye in ("left", "right"):
        (place / eye).mkdir(parents=True)
        for n, frame in enumerate(room[1]):
            cv2.imwrite(str(place / eye / f"{n:06d}.png"), getattr(frame, eye)[..., ::-1])
    return place


@pytest.fixture(scope="module")
def flat(folder, room, tmp_path_factory):
    """What comes out, with the focal length known."""
    out = tmp_path_factory.mktemp("flat") / "out"
    focal = f"{room[0].left.focal_px}"
    assert main(["rectify", str(folder), str(out), "--uncalibrated", "--focal", focal]) == 0
    return out


def test_rows_meet_and_the_scale_is_said_to_be_unknown(folder, room, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["rectify", str(folder), str(out), "--uncalibrated"]) == 0
    text = capsys.readouterr().out
    assert "SCALE UNKNOWN" in text
    assert "focal length" in text
    assert "planes and straight lines" in text
    assert " m," not in text.splitlines()[1]
    assert main(["rectify", str(folder), str(out), "--uncalibrated", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["row_difference_px"] < 0.15
    assert report["uncalibrated"]["rows_before_px"] > 3
    assert report["uncalibrated"]["focal_from"] in ("assumed", "seen")
    assert report["views"][0]["metric"] is False


def test_what_is_written_is_a_pair_like_any_other_but_for_metres(flat, tmp_path, capsys):
    rig = read_rig(flat / "rig.json")
    assert rig.is_rectified
    assert not rig.metric
    capsys.readouterr()
    assert main(["check", str(flat), "--json"]) == 0
    findings = {f["name"]: f for f in json.loads(capsys.readouterr().out)["findings"]}
    assert findings["rows"]["severity"] == "good"
    assert findings["baseline"]["severity"] == "warn"
    assert main(["convert", str(flat), str(tmp_path / "out"), "--to", "ply"]) == 0
    said = capsys.readouterr()
    assert "not in metres" in said.out + said.err
    assert "of unknown scale" in (tmp_path / "out" / "report.html").read_text()


def test_cameras_json_takes_the_pictures_as_they_are(folder, flat, tmp_path):
    """The same cloud from the bare pictures with cameras.json, and from what was written."""
    clouds = []
    for source, more in ((folder, ["--rig", str(flat / "cameras.json")]), (flat, [])):
        out = tmp_path / source.name
        assert main(["convert", str(source), str(out), "--to", "npz", "--frames", "0", *more]) == 0
        with np.load(out / "npz" / "000000.npz") as arrays:
            clouds.append(arrays["xyz"])
    np.testing.assert_array_equal(*clouds)


@pytest.mark.parametrize("kind", ["baseline", "box"])
def test_a_known_distance_gives_metres(folder, room, tmp_path, capsys, kind):
    rig, frames = room
    truth = frames[1].truth.values
    u, v = rig.left.width_px // 2, int(0.85 * rig.left.height_px)
    depth_m = rig.fB_px_m / truth[v, u]
    known = f"baseline:{rig.baseline_m}"
    if kind == "box":
        known = f"box:{u - 15},{v - 4},{u + 15},{v + 4}={depth_m:.4f}@000001"
    out = tmp_path / "out"
    call = ["rectify", str(folder), str(out), "--uncalibrated", "--focal", f"{rig.left.focal_px}"]
    assert main([*call, "--known-distance", known, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["uncalibrated"]["metric"] is True
    found = read_rig(out / "rig.json")
    assert found.metric
    assert found.baseline_m == pytest.approx(
        rig.baseline_m, rel=1e-9 if kind == "baseline" else 0.1
    )
    assert "scale:" in found.origin


def test_killed_and_told_again_it_goes_on(folder, flat, room, capsys):
    call = ["rectify", str(folder), str(flat), "--uncalibrated", "--focal"]
    before = {path: path.read_bytes() for path in flat.rglob("*.png")}
    capsys.readouterr()
    assert main([*call, f"{room[0].left.focal_px}"]) == 0
    assert {path: path.read_bytes() for path in flat.rglob("*.png")} == before
    assert main([*call, "123"]) == 2  # other settings
    assert "--overwrite" in capsys.readouterr().err


def test_the_rig_beside_the_pictures_is_withheld(folder, room, tmp_path, capsys):
    rig = replace(room[0], T_left_velodyne=None, T_velodyne_imu=None)
    write_rig(folder / "rig.json", rig)
    try:
        call = ["rectify", str(folder), str(tmp_path / "out"), "--uncalibrated", "--json"]
        assert main(call) == 0
        assert json.loads(capsys.readouterr().out)["row_difference_px"] < 0.15
    finally:
        (folder / "rig.json").unlink()


@pytest.mark.parametrize(
    ("flags", "code", "said"),
    [
        (["--focal", "500"], "UsageError", "without --uncalibrated"),
        (["--uncalibrated", "--rig", "rig.json"], "UsageError", "--uncalibrated and --rig"),
        (["--uncalibrated", "--focal", "-3"], "UsageError", "focal length of -3"),
        (["--uncalibrated", "--known-distance", "5"], "UsageError", "'5'"),
        (["--uncalibrated", "--swap"], "PairSwapped", "farther right"),
        (
            ["--uncalibrated", "--known-distance", "box:1,1,9,9=2@000009"],
            "UsageError",
            "no frame '000009'",
        ),
    ],
)
def test_what_is_refused(folder, tmp_path, capsys, flags, code, said):
    capsys.readouterr()
    main(["rectify", str(folder), str(tmp_path / "out"), *flags, "--json"])
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == code
    assert said in error["got"]
    assert not (tmp_path / "out").exists()


def test_pictures_that_tell_nothing_and_rectified_sources(tmp_path, capsys):
    for eye in ("left", "right"):
        (tmp_path / "blank" / eye).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / "blank" / eye / "0.png"), np.full((90, 120), 128, np.uint8))
    call = ["rectify", str(tmp_path / "blank"), str(tmp_path / "out"), "--uncalibrated", "--json"]
    assert main(call) == 3
    assert "0 of 0 matches agree" in json.loads(capsys.readouterr().out)["error"]["got"]
    assert main(["rectify", "synthetic:room", str(tmp_path / "o"), "--uncalibrated"]) == 2
