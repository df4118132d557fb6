"""`pseudolidar align`: the places of the pairs of a body from their pictures alone."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar import cli
from pseudolidar.formats.rigs.body_json import read_body, write_body
from tests.body_rigs import body_rig, off_by, perturbed, write_pairs
from tests.calibration.test_overlap_board import BEARINGS_DEG, SCALE, SQUARE_M, held, seen


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("align") / "street"
    write_pairs(folder, 1, body=perturbed(body_rig(), turn_deg=1.0, shift_m=0.05))
    return folder


LOOSE = ("--trust.worst-shift-m", "9", "--trust.worst-turn-deg", "90", "--min-depth", "1")


def test_places_are_written_with_how_sure_they_are(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rig.json"
    args = ["align", str(street), "--out", str(out), "--json", *LOOSE]
    assert cli.main(args) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["root"] == "front"
    assert set(told["pairs"]) == {"left", "right"}
    given, found = read_body(street / "rig.json"), read_body(out)
    np.testing.assert_array_equal(
        found["front"].T_base_link_left.matrix, given["front"].T_base_link_left.matrix
    )
    for name, figures in told["pairs"].items():
        pair = found[name]
        want = figures["T_base_link_left"]
        np.testing.assert_allclose(pair.T_base_link_left.matrix, want, atol=1e-12)
        assert pair.translation_sigma_m is not None
        assert pair.rotation_sigma_rad is not None
        assert figures["residual_m"] < figures["residual_before_m"]
        assert figures["matches"] > 300
    assert "aligned on 3 stereo pairs on one body" in found.origin
    # Other commands take it.
    assert cli.main(["info", str(street)]) == 0
    args = ["convert", str(street), str(tmp_path / "out"), "--rig", str(out), "--no-check"]
    assert cli.main(args) == 0
    # What was there is kept, and what is no rig stays as it is.
    first = out.read_bytes()
    assert cli.main(["align", str(street), "--out", str(out), "--overwrite", *LOOSE]) == 0
    assert (tmp_path / "rig.previous.json").read_bytes() == first
    picture = tmp_path / "left.png"
    picture.write_bytes(b"\x89PNG, mine")
    assert cli.main(["align", str(street), "--out", str(picture), "--overwrite", *LOOSE]) == 2
    assert picture.read_bytes() == b"\x89PNG, mine"


@pytest.mark.parametrize(
    ("flags", "code", "kind", "words"),
    [
        ((), 3, "OverlapInsufficient", "known to"),
        (("--by.least-matches", "100000"), 3, "OverlapInsufficient", "shares too little"),
        (("--root", "rear"), 2, "UsageError", "no pair 'rear'"),
        (("--out", "taken.json"), 2, "UsageError", "such a file already"),
    ],
)
def test_what_is_not_known_is_refused_and_writes_nothing(
    flags: tuple[str, ...], code: int, kind: str, words: str, street: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.json").write_text("mine")
    flags = (*flags, "--trust.worst-shift-m", "0.01", "--json", "--no-check")
    assert cli.main(["align", str(street), *flags]) == code
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == kind
    assert words in error["got"]
    assert not (tmp_path / "rig.json").exists()
    assert (tmp_path / "taken.json").read_text() == "mine"


def test_a_single_pair_is_no_body(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["align", str(street / "front"), "--rig", f"{street / 'rig.json'}#front"]
    assert cli.main([*args, "--out", str(tmp_path / "rig.json")]) == 3
    assert "NoPairs" in capsys.readouterr().err
    assert cli.main(["align", "synthetic:street", "--out", str(tmp_path / "rig.json")]) == 3


def test_places_from_a_board_that_is_held_up_to_two_pairs_at_a_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = tmp_path / "boards", tmp_path / "rig.json"
    write_body_file(folder)
    for at, (neighbour, bearing_deg) in enumerate(BEARINGS_DEG.items()):
        for number in range(3):
            for name in ("front", neighbour):
                pair = seen(held(bearing_deg, number), name, number)
                for eye, picture in (("left", pair.left), ("right", pair.right)):
                    path = folder / name / eye / f"{3 * at + number:06d}.png"
                    path.parent.mkdir(parents=True, exist_ok=True)
                    cv2.imwrite(str(path), picture)
    args = ["align", str(folder), "--by", "shared-board", "--by.board", "chessboard:9x6"]
    args += ["--by.square", str(SQUARE_M), "--out", str(out), "--no-check", "--json"]
    assert cli.main(args) == 0
    told = json.loads(capsys.readouterr().out)
    found = read_body(out)
    for name in ("left", "right"):
        off_m, off_deg = off_by(found, name)
        assert off_m < 0.01
        assert off_deg < 0.25
        assert told["pairs"][name]["matches"] == 3 * 54
    assert cli.main([*args[:-4], "--by.square", "0", "--out", str(tmp_path / "a.json")]) == 2
    assert "squares of 0 m" in capsys.readouterr().err


def write_body_file(folder: Path) -> None:
    folder.mkdir()
    wrong = perturbed(body_rig(SCALE), turn_deg=2.0, shift_m=0.1, seed=7)
    write_body(folder / "rig.json", wrong)


@pytest.mark.slow
def test_three_pairs_on_a_street_come_near_to_where_they_are(tmp_path: Path) -> None:
    """Pictures of 640x400, matched: within three of its own standard deviations, and improved."""
    folder, out = tmp_path / "street", tmp_path / "rig.json"
    wrong = perturbed(body_rig(2), turn_deg=2.0, shift_m=0.1, seed=4)
    write_pairs(folder, 8, body=wrong, scale=2)
    assert cli.main(["align", str(folder), "--out", str(out), "--min-depth", "1"]) == 0
    found = read_body(out)
    for name in ("left", "right"):
        off_m, off_deg = off_by(found, name)
        pair = found[name]
        assert pair.translation_sigma_m is not None
        assert off_m < 3 * np.linalg.norm(pair.translation_sigma_m)
        assert off_m < 0.08
        assert off_deg < 0.5
