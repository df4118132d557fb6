"""Things nearer than what is searched: every verb that matches says so before it begins."""

from __future__ import annotations

import json
import re

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.points.npz import read_npz
from tests.pipelines.conftest import RIG

WIDTH_PX, HEIGHT_PX, DISPARITY_PX = 320, 160, 50
# Of the rig: 100 px times 0.5 m.
DEPTH_M = 50 / DISPARITY_PX
CALIBRATED_M = 0.7


@pytest.fixture(scope="module")
def close(tmp_path_factory):
    """A wall of random texture 1 m away: at 50 px, where 3 m ask for 32 to be searched."""
    folder = tmp_path_factory.mktemp("close") / "pairs"
    wide = np.random.default_rng(1).integers(0, 256, (HEIGHT_PX, WIDTH_PX + DISPARITY_PX), np.uint8)
    wide = cv2.GaussianBlur(wide, (0, 0), 1.5)
    wide = cv2.normalize(wide, None, 0, 255, cv2.NORM_MINMAX)
    for eye, image in (("left", wide[:, :-DISPARITY_PX]), ("right", wide[:, DISPARITY_PX:])):
        (folder / eye).mkdir(parents=True)
        cv2.imwrite(str(folder / eye / "0.png"), image)
    centre = {"fx": 100.0, "cx": (WIDTH_PX - 1) / 2, "cy": (HEIGHT_PX - 1) / 2}
    rig = RIG | {"width_px": WIDTH_PX, "height_px": HEIGHT_PX, "left": centre, "right": centre}
    (folder / "rig.json").write_text(json.dumps(rig))
    return folder


def near_lines(caplog):
    return [line for line in caplog.messages if line.startswith("check: nearest depth")]


def depth_m(out):
    cloud = read_npz(out / "npz" / "0.npz")
    return float(np.median(cloud.xyz[:, 2]))


def test_the_line_of_convert_names_the_flag_that_finds_them(close, tmp_path, caplog):
    line = ["convert", str(close), str(tmp_path / "out"), "--to", "npz"]
    assert main([*line, "--dry-run"]) in (0, 3)
    (said,) = near_lines(caplog)
    assert re.search(r"100% of \d+ matches are nearer than the 1.6 m that are searched", said)
    flags = re.search(r"Pass (--min-depth) ([0-9.]+)\.$", said).groups()
    assert float(flags[1]) < DEPTH_M
    caplog.clear()
    assert main([*line, *flags]) == 0
    assert not near_lines(caplog)
    assert depth_m(tmp_path / "out") == pytest.approx(DEPTH_M, rel=0.01)


@pytest.mark.parametrize("verb", ["evaluate disparity", "compare"])
def test_every_verb_that_matches_says_it(close, caplog, verb):
    """Also where it stops afterwards, as there is nothing to compare with."""
    assert main([*verb.split(), str(close)]) == 3
    assert len(near_lines(caplog)) == 1


def test_disparities_that_are_said_are_judged_as_well(close, tmp_path, caplog, capsys):
    line = ["convert", str(close), str(tmp_path / "out"), "--dry-run", "--matcher", "sgbm"]
    main([*line, "--matcher.disparities", "48"])
    (said,) = near_lines(caplog)
    assert "Leave --matcher.disparities out and pass --min-depth 0.8" in said
    capsys.readouterr()
    assert main(["check", str(close), "--json"]) == 0
    found = {f["name"]: f for f in json.loads(capsys.readouterr().out)["findings"]}
    assert found["nearest depth"]["severity"] == "warn"
    assert found["nearest depth"]["nearest_seen_m"] == pytest.approx(DEPTH_M, rel=0.01)
    assert found["nearest depth"]["disparities"] == 32


def test_a_rig_that_was_calibrated_near_is_searched_near(close, tmp_path, caplog):
    """No flag: the rig says how near the board was held; a flag counts more."""
    rig = json.loads((close / "rig.json").read_text())
    rig["quality"] = {"nearest_m": CALIBRATED_M}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    out = tmp_path / "out"
    line = ["convert", str(close), str(out), "--to", "npz", "--rig", str(tmp_path / "rig.json")]
    assert main(line) == 0
    assert not near_lines(caplog)
    assert "nearest depth: 0.6 m, as near as the board was held; --min-depth takes another" in (
        caplog.messages
    )
    assert depth_m(out) == pytest.approx(DEPTH_M, rel=0.01)
    caplog.clear()
    main([*line[:2], str(tmp_path / "far"), *line[3:], "--min-depth", "3", "--dry-run"])
    assert len(near_lines(caplog)) == 1
