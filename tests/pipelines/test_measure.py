"""measure: a box in the picture, answered on the terminal."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main

# A target 0.4 m wide and 0.5 m high, 5 m away, before a wall at 10 m: whole disparities.
FOCAL_PX, BASELINE_M, WIDTH, HEIGHT = 400.0, 0.2, 480, 320
NEAR_PX, FAR_PX = 16, 8
LEFT, TOP, RIGHT, BOTTOM = 224, 140, 255, 179


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("measure")
    rng = np.random.default_rng(3)

    def texture(width: int, height: int) -> np.ndarray:
        return cv2.GaussianBlur(rng.integers(0, 256, (height, width)).astype(np.uint8), (0, 0), 1.0)

    wall, target = texture(WIDTH + FAR_PX, HEIGHT), texture(RIGHT - LEFT + 1, BOTTOM - TOP + 1)
    left, right = wall[:, :WIDTH].copy(), wall[:, FAR_PX:].copy()
    left[TOP : BOTTOM + 1, LEFT : RIGHT + 1] = target
    right[TOP : BOTTOM + 1, LEFT - NEAR_PX : RIGHT + 1 - NEAR_PX] = target
    for eye, picture in (("left", left), ("right", right)):
        (folder / eye).mkdir()
        cv2.imwrite(str(folder / eye / "0.png"), picture)
    camera = {"fx": FOCAL_PX, "fy": FOCAL_PX, "cx": 239.5, "cy": 159.5}
    rig = {"schema": 1, "width_px": WIDTH, "height_px": HEIGHT, "baseline_m": BASELINE_M}
    (folder / "rig.json").write_text(json.dumps({**rig, "left": camera, "right": camera}))
    return folder


def told(capsys, *args: object, code: int = 0) -> dict:
    capsys.readouterr()
    assert main(["measure", *map(str, args), "--json"]) == code
    return json.loads(capsys.readouterr().out)


# Edges of its outer pixels, which have their middles at whole numbers.
BOX = f"{LEFT - 0.5},{TOP - 0.5},{RIGHT + 0.5},{BOTTOM + 0.5}"


def test_a_target_is_as_far_and_as_big_as_it_is(pair: Path, capsys) -> None:
    (found,) = told(capsys, pair, "--box", BOX)["measured"]
    assert found["distance_m"] == pytest.approx(5.0, rel=0.01)
    assert found["sigma_distance_m"] < 0.3
    assert found["across_m"] == pytest.approx(0.40, rel=0.03)
    assert found["size_m"][2] == pytest.approx(0.50, rel=0.05)
    assert found["measured_by"] == "patch"
    # drawn too wide by half it is still the target, not the wall
    wide = f"{LEFT - 8},{TOP - 8},{RIGHT + 8},{BOTTOM + 8}"
    (again,) = told(capsys, pair, "--box", wide)["measured"]
    assert again["distance_m"] == pytest.approx(5.0, rel=0.02)


def test_a_table_for_people_says_what_to_be_careful_about(pair: Path, tmp_path, capsys) -> None:
    boxes = tmp_path / "boxes.csv"
    boxes.write_text(f"left,top,right,bottom,class\n{BOX},sign\n0,140,30,179,wall\n")
    assert main(["measure", str(pair), "--box", str(boxes)]) == 0
    out = capsys.readouterr().out
    assert "5.0" in out.split("sign", 1)[1].splitlines()[0]
    assert "wall: cut by the border of the picture" in out


def test_what_cannot_be_measured_is_refused(pair: Path, tmp_path, capsys) -> None:
    error = told(capsys, pair, "--box", "600,10,700,20", code=3)["error"]
    assert "in the picture of 480x320" in error["want"]
    other = tmp_path / "other.csv"
    other.write_text("frame,left,top,right,bottom\nanother,1,2,3,4\n")
    error = told(capsys, pair, "--box", other, code=2)["error"]
    assert "no box for frame 0" in error["got"]
    for box in ("1,2,3", "nan,1,2,3", "1,2,inf,4", "5,1,5,9", "9,1,5,9", "1,2,1e999,3"):
        error = told(capsys, pair, f"--box={box}", code=2)["error"]
        assert "LEFT,TOP,RIGHT,BOTTOM" in error["want"]
    error = told(capsys, pair, "--box", tmp_path / "none.csv", code=3)["error"]
    assert error["fix"] == "Check the path."
    for depth in ("0", "-1", "nan"):
        error = told(capsys, pair, "--box", BOX, "--min-depth", depth, code=3)["error"]
        assert error["where"] == "--min-depth"


def test_what_cannot_be_matched_is_said_not_to_be_measured(tmp_path, pair: Path, capsys) -> None:
    """A sky of one colour, a box below a pixel, and a name that would write on the terminal."""
    rig = (pair / "rig.json").read_text()
    for eye in ("left", "right"):
        picture = cv2.imread(str(pair / eye / "0.png"))
        picture[:60] = 200
        (tmp_path / eye).mkdir()
        cv2.imwrite(str(tmp_path / eye / "0.png"), picture)
    (tmp_path / "rig.json").write_text(rig)
    for box in ("300,5,340,40", "300,20.2,300.4,20.4"):
        job = ["measure", str(tmp_path), "--box", box, "--name", "a\x1b[31m\nb"]
        assert main(job) == 4
        out = capsys.readouterr().out
        assert "it is not measured" in out
        assert " +- " not in out
        assert "hides part" not in out
        assert "\x1b" not in out
        assert r"a\x1b[31m\nb: nothing in it was matched" in out


def test_only_frames_with_a_box_are_matched_and_a_bad_one_is_told(
    pair: Path, tmp_path, capsys, caplog
):
    for eye in ("left", "right"):
        (tmp_path / eye).mkdir()
        for name in ("0", "1", "2"):
            picture = cv2.imread(str(pair / eye / "0.png"))
            cv2.imwrite(str(tmp_path / eye / f"{name}.png"), picture)
    (tmp_path / "rig.json").write_text((pair / "rig.json").read_text())
    bad = tmp_path / "left" / "1.png"
    bad.write_bytes(bad.read_bytes()[:3000])
    boxes = tmp_path / "boxes.csv"
    head = "frame,left,top,right,bottom\n"
    job = (tmp_path, "--box", boxes, "--frame", ":", "--no-check")
    boxes.write_text(f"{head}00,{BOX}\n2,{BOX}\n77,{BOX}\n")
    with caplog.at_level(logging.WARNING):
        found = told(capsys, *job)
    (warned,) = [line for line in caplog.messages if "does not have" in line]
    assert "does not have: 77; it has such as 0" in warned
    assert [one["frame"] for one in found["measured"]] == ["0", "2"]
    boxes.write_text(f"{head}0,{BOX}\n1,{BOX}\n")
    found = told(capsys, *job, code=4)
    assert [one["frame"] for one in found["measured"]] == ["0"]
    assert [(one["frame"], one["code"]) for one in found["skipped"]] == [("1", "ImageTruncated")]
