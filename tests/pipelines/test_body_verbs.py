"""Every verb on the folder of several pairs: it works, or says what to give; and on one of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from pseudolidar import cli
from pseudolidar.formats.rigs.rig_json import write_rig
from tests.body_rigs import MOUNTS, body_rig, write_pairs

BOARD = ("--board", "chessboard:9x6", "--square", "0.03")


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verbs") / "street"
    write_pairs(folder, 1)
    return folder


@pytest.mark.parametrize(
    ("verb", "code", "words"),
    [
        (("compare", "BODY", "OUT"), "NoPairs", "give its folder"),
        (("refine", "BODY", "--out", "OUT"), "NoPairs", "give its folder"),
        (("tune", "BODY", "--out", "OUT"), "NoPairs", "give its folder"),
        (("evaluate", "disparity", "BODY"), "NoPairs", "give its folder"),
        (("evaluate", "cloud", "BODY"), "NoPairs", "give its folder"),
        (("calibrate", "BODY", *BOARD, "--out", "OUT"), "NoPairs", "give its folder"),
        (("rectify", "BODY", "OUT"), "NoPairs", "give its folder"),
        (("rectify", "BODY", "OUT", "--uncalibrated"), "NoPairs", "give its folder"),
        (("convert", "BODY", "OUT", "--to", "npz,depth"), "NoPairs", "Leave depth out"),
        (("convert", "BODY", "OUT", "--to", "kitti"), "NoPairs", "Leave kitti out"),
        (("compare", "BODY/front", "OUT", "--reference", "BODY"), "NoPairs", "convert BODY OUT"),
        (("merge", "BODY", "clouds.pcd"), "NoClouds", "convert SOURCE OUT --to mcap"),
        (("check", "BODY", "--out", "OUT"), "UsageError", "Give the folder of one pair"),
        (("rig", "BODY"), "CalibrationField", "rig.json#front"),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, tuple) else "",
)
def test_what_takes_one_pair_says_so_and_writes_nothing(
    verb: tuple[str, ...], code: str, words: str, street: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "out.json"
    places = {"OUT": str(out), "BODY": str(street)}
    args = [places.get(arg, arg.replace("BODY/", f"{street}/")) for arg in verb]
    assert cli.main([*args, "--json"]) in (2, 3)
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == code
    assert words in error["fix"]
    assert not out.exists()


def test_check_looks_at_each_pair(street: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", str(street), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told["body"]) == list(MOUNTS)
    assert told["stops"] is False
    for pair in told["body"].values():
        named = {finding["name"]: finding["severity"] for finding in pair["findings"]}
        assert named["rows"] == named["eyes"] == "good"
        assert [looked["id"] for looked in pair["pairs"]] == ["000000"]


def test_check_names_the_pair_whose_eyes_are_exchanged(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body = tmp_path / "body"
    body.mkdir()
    (body / "rig.json").write_bytes((street / "rig.json").read_bytes())
    for name in MOUNTS:
        eyes = ("right", "left") if name == "left" else ("left", "right")
        (body / name).mkdir()
        for eye, shown in zip(("left", "right"), eyes, strict=True):
            (body / name / eye).symlink_to(street / name / shown)
    assert cli.main(["check", str(body), "--json"]) == 3
    pairs = json.loads(capsys.readouterr().out)["body"]
    assert {name: pair["stops"] for name, pair in pairs.items()} == {
        "front": False, "left": True, "right": False,
    }  # fmt: skip
    assert cli.main(["check", str(body)]) == 3
    text = capsys.readouterr().out
    assert text.count("A run would stop: eyes") == 1
    assert text.index("\nleft: ") < text.index("A run would stop") < text.index("\nright: ")


def test_info_tells_the_pairs_and_where_they_stand(
    street: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["info", str(street / "rig.json"), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["paths"]
    assert told["kind"] == "calibration"
    looks = {row["pair"]: row["looks_left_deg"] for row in told["entries"]}
    assert looks == pytest.approx({name: yaw for name, (yaw, _) in MOUNTS.items()})
    assert [pair["baseline_m"] for pair in told["pairs"]] == [0.4, 0.4, 0.4]
    assert cli.main(["info", str(street / "rig.json")]) == 0
    assert "3 stereo pairs on one body (front, left, right)" in capsys.readouterr().out


def test_the_folder_of_a_pair_finds_its_rig_beside_it(
    street: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert cli.main(["check", str(street / "left"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["path"] == str(street / "left")
    monkeypatch.chdir(street / "left")
    assert cli.main(["info", ".", "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["paths"]
    assert told["rig"]["baseline_m"] == pytest.approx(0.4)
    # A folder of another name is no pair of this body, and a rig of its own comes first.
    (tmp_path / "rig.json").write_bytes((street / "rig.json").read_bytes())
    for name in ("other", "right"):
        (tmp_path / name).mkdir()
        for eye in ("left", "right"):
            (tmp_path / name / eye).symlink_to(street / "right" / eye)
    capsys.readouterr()
    assert cli.main(["info", str(tmp_path / "other"), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["paths"]
    assert told["unknown"][0]["code"] == "CalibrationMissing"
    own = replace(body_rig()["right"].rig, origin="its own")
    write_rig(tmp_path / "right" / "rig.json", own)
    assert cli.main(["info", str(tmp_path / "right"), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["paths"]
    assert told["rig"]["origin"] == "its own"
