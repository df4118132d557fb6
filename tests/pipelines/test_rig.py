"""`pseudolidar rig`: what a calibration says, and other forms of it, as a user has it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar import cli
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import write_rig
from tests.raw_rigs import raw_rig
from tests.recordings import small_rig

P = "1 0 0 0\n0 1 0 0\n0 0 1 0\n"


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    write_rig(tmp_path / "raw.json", raw_rig(5))
    return tmp_path / "raw.json"


def called(capsys: pytest.CaptureFixture[str], *args: object) -> dict:  # type: ignore[type-arg]
    assert cli.main(["rig", *map(str, args), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_figures_of_a_rectified_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = small_rig()
    write_rig(tmp_path / "rig.json", rig)
    told = called(capsys, tmp_path / "rig.json")
    assert told["rectified"] is True
    assert told["why_unrectified"] == []
    assert told["f_px"] == rig.left.focal_px
    assert told["baseline_m"] == pytest.approx(rig.baseline_m)
    assert told["fB_px_m"] == pytest.approx(rig.fB_px_m)
    assert told["depth_at_1_px_m"] == pytest.approx(rig.fB_px_m)
    # sigma_Z = Z^2 / (f B) for one pixel
    (at_10_m,) = [each["error_m"] for each in told["pixel_errors"] if each["depth_m"] == 10]
    assert at_10_m == pytest.approx(100 / rig.fB_px_m)
    right = told["projections"]["P_right"]
    np.testing.assert_allclose(right["t"], rig.T_right_left.translation_m)
    np.testing.assert_allclose(right["centre"], -rig.T_right_left.translation_m)
    assert told["warnings"] == []
    assert cli.main(["rig", str(tmp_path / "rig.json")]) == 0
    text = capsys.readouterr().out
    assert "a rectified pair (rig.json)" in text
    assert f"{rig.fB_px_m:.5g} px m" in text


def test_figures_of_unrectified_cameras(raw: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = called(capsys, raw)
    assert told["rectified"] is False
    assert "distortion of pinhole lenses" in told["why_unrectified"]
    assert told["rotation_deg"] == pytest.approx(np.degrees(np.linalg.norm([0.02, -0.03, 0.01])))
    # After rectification, as OpenCV computes it.
    rig = raw_rig(5)
    T = rig.T_right_left.matrix
    P2 = cv2.stereoRectify(rig.left.K, rig.left.distortion, rig.right.K, rig.right.distortion,
                           (640, 480), T[:3, :3], T[:3, 3:], alpha=0)[3]  # fmt: skip
    assert told["f_px"] == pytest.approx(P2[0, 0], rel=2e-3)
    assert told["fB_px_m"] == pytest.approx(-P2[0, 3], rel=2e-3)


def test_round_trip_by_way_of_other_forms(raw: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """rig.json to OpenCV XML, to ROS, to KITTI raw, and back to rig.json: the same cameras."""
    folder = raw.parent
    called(capsys, raw, "--out", folder / "a.xml")
    told = called(capsys, folder / "a.xml", "--out", folder / "ros", "--to", "ros")
    assert told["written"]["files"] == [str(folder / "ros" / f"{eye}.yaml")
                                        for eye in ("left", "right")]  # fmt: skip
    called(capsys, folder / "ros", "--pictures", "raw", "--out", folder / "back.json")
    rig, got = raw_rig(5), read_any_rig(folder / "back.json").raw
    assert got is not None
    np.testing.assert_array_equal(got.left.K, rig.left.K)
    np.testing.assert_array_equal(got.right.distortion, rig.right.distortion)
    np.testing.assert_allclose(got.T_right_left.matrix, rig.T_right_left.matrix, atol=1e-14)
    told = called(capsys, folder / "ros", "--out", folder / "flat.json")
    assert told["rectified"] is True
    assert read_any_rig(folder / "flat.json").rectified is not None


def test_an_odd_rig_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "K.txt").write_text("900 0 639.5 0 800 359.5 0 0 1\n3.5\n")
    told = called(capsys, tmp_path / "K.txt", "--size", "1280x720")
    assert any("not square" in warning for warning in told["warnings"])
    assert any("3.5 m apart" in warning for warning in told["warnings"])
    assert cli.main(["rig", str(tmp_path / "K.txt"), "--size", "1280x720"]) == 0
    assert "\nwarning: " in capsys.readouterr().out


def test_the_size_of_pictures_beside_the_file_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "K.txt").write_text("800 0 639.5 0 800 359.5 0 0 1\n0.1\n")
    assert called(capsys, tmp_path / "K.txt")["left"]["width_px"] is None
    out = tmp_path / "rig.json"
    assert cli.main(["rig", str(tmp_path / "K.txt"), "--out", str(out), "--json"]) == 3
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "CalibrationField"
    assert "--size" in error["fix"]
    assert not out.exists()
    (tmp_path / "image_0").mkdir()
    cv2.imwrite(str(tmp_path / "image_0" / "000000.png"), np.zeros((720, 1280), np.uint8))
    told = called(capsys, tmp_path / "K.txt", "--out", out)
    assert told["left"]["width_px"] == 1280
    assert read_any_rig(out).of_rectified.left.size_px == (1280, 720)


def test_nothing_is_replaced_unasked(raw: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = raw.parent / "a.yml"
    out.write_text("mine\n")
    assert cli.main(["rig", str(raw), "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert out.read_text() == "mine\n"
    ros = raw.parent / "ros"
    ros.mkdir()
    (ros / "right.yaml").write_text("mine\n")
    assert cli.main(["rig", str(raw), "--out", str(ros), "--to", "ros"]) == 2
    assert not (ros / "left.yaml").exists()
    called(capsys, raw, "--out", out, "--overwrite")
    assert out.read_text().startswith("%YAML")
    picture = raw.parent / "left.jpg"
    picture.write_bytes(b"\xff\xd8\xff\xe0mine")
    line = ["rig", str(raw), "--out", str(picture), "--to", "opencv", "--overwrite"]
    assert cli.main(line) == 2
    assert picture.read_bytes() == b"\xff\xd8\xff\xe0mine"


def test_a_lens_that_is_seen_further_than_its_model_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Real fisheyes calibrated in the middle: the formula turns back at 75 degrees."""
    K = [[227.5, 0, 472.1], [0, 227.0, 307.5], [0, 0, 1]]
    lens = {"K": K, "model": "fisheye", "distortion": [0.0215, -0.0168, 0.0137, -0.0052]}
    eyes = {"left": lens, "right": lens, "baseline_m": 0.11}
    rig = tmp_path / "rig.json"
    rig.write_text(json.dumps({"schema": 1, "width_px": 960, "height_px": 600, **eyes}))
    across, down = called(capsys, rig)["left"]["field_deg"]
    assert across is None
    assert 145 < down < 155
    assert cli.main(["rig", str(rig)]) == 0
    out = capsys.readouterr().out
    assert "wider" in out
    assert "nan" not in out


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (("absent.json",), 3, "no such file"),
        (("raw.json", "--out", "x.toml"), 2, "--to"),
        (("raw.json", "--out", "calib.txt"), 3, "distortion of pinhole lenses"),
        (("raw.json", "--out", "camchain.yaml"), 3, "Kalibr's radtan"),
        (("K.txt", "--pictures", "raw"), 0, ""),
        (("p.yml", "--pictures", "raw"), 3, "rectified pictures alone"),
        (("raw.json", "--pictures", "rectified"), 3, "a rig of unrectified cameras"),
        (("raw.json", "--out", "absent/folder/a.yml"), 0, ""),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(
    args: tuple[str, ...], code: int, words: str, raw: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(raw.parent)
    (raw.parent / "K.txt").write_text("800 0 639.5 0 800 359.5 0 0 1\n0.1\n")
    rows = "500, 0, 320, {}, 0, 500, 240, 0, 0, 0, 1, 0"
    (raw.parent / "p.yml").write_text(
        f"image_width: 640\nimage_height: 480\nP1: [{rows.format(0)}]\nP2: [{rows.format(-50)}]\n"
    )
    assert cli.main(["rig", *args]) == code
    err = capsys.readouterr().err
    assert words in err
    assert "Traceback" not in err


@pytest.mark.real
def test_the_real_calibrations(real_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = called(capsys, real_data / "kitti_raw" / "2011_09_26")
    assert told["baseline_m"] == pytest.approx(0.53273, abs=2e-5)
    assert list(told["projections"]) == [f"P_rect_0{n}" for n in range(4)]
    assert told["velodyne"] is True
    for name, code in (("odd_formats", "CalibrationValue"), ("bike_avoidance", "CalibrationValue")):
        assert cli.main(["rig", str(real_data / name), "--size", "1280x960", "--json"]) == 3
        error = json.loads(capsys.readouterr().out)["error"]
        assert error["code"] == code
        assert all(error[key] for key in ("path", "where", "got", "want", "fix"))
