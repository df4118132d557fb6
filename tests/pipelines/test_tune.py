"""`pseudolidar tune`: files, figures on other worlds, stopping and going on, refusals."""

from __future__ import annotations

import functools
import json
import signal
import subprocess
import sys
import time

import pytest

from pseudolidar.cli import main
from pseudolidar.formats.pictures.image import read_image

ROOM = ("synthetic:room:5", "--source.seed", "2", "--source.width-px", "200")
SMALL = ("--tune-frames", "2", "--held-frames", "1", "--workers", "1", "--budget", "10m")


def told(capsys, *arguments, status=0):
    assert main([*map(str, arguments), "--json"]) == status
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """Settings that were tuned on one room."""
    folder = tmp_path_factory.mktemp("tuned")
    out, picture = folder / "settings.json", folder / "trials.png"
    line = ["tune", *ROOM, *SMALL, "--out", str(out), "--candidates", "40"]
    assert main([*line, "--picture", str(picture)]) == 0
    return out


def test_the_file_has_settings_and_says_what_they_are_worth(tuned):
    file = json.loads(tuned.read_text())
    assert set(file) == {"schema", "tuned", "settings"}
    assert set(file["settings"]) == {"matcher", "smooth", "fill"}
    said = file["tuned"]
    assert (said["by"], said["seed"]) == ("truth", 0)
    assert said["loss_tuned_on"] < 0.9
    assert said["loss_held"] < 0.95
    assert said["held_best"]["loss"] < said["held_first"]["loss"]
    assert not set(said["tuned_on"]) & set(said["held"])
    assert read_image(tuned.with_name("trials.png")).pixels.shape[1] > 1000


def test_they_are_better_in_another_room_too(tuned, capsys):
    other = ("synthetic:room:3", "--source.seed", "9", "--source.width-px", "200")
    first = told(capsys, "evaluate", "disparity", *other)
    best = told(capsys, "evaluate", "disparity", *other, "--settings", tuned)
    assert best["epe"] < 0.9 * first["epe"]
    assert best["bad_1"] < first["bad_1"]
    assert best["density"] > first["density"] - 0.01


def test_every_command_takes_them(tuned, capsys, tmp_path):
    settings = ("--settings", str(tuned))
    source = ("synthetic:room:2", "--source.width-px", "200")
    assert main(["convert", *source, str(tmp_path / "out"), *settings]) == 0
    capsys.readouterr()
    used = json.loads((tmp_path / "out" / "run.json").read_text())["settings"]
    file = json.loads(tuned.read_text())["settings"]
    assert used["matcher"] == file["matcher"]
    assert used["smooth"] == file["smooth"]
    told(capsys, "compare", *source, tmp_path / "compared", *settings)
    told(capsys, "check", *source, *settings)
    told(capsys, "info", source[0], *settings)
    few = (*SMALL, "--candidates", 1, "--keep", "matcher.quality, smooth")
    again = told(capsys, "tune", *source, *few, *settings, "--out", tmp_path / "b.json")
    assert again["settings"]["matcher"] == file["matcher"]


@pytest.mark.parametrize(
    ("path", "value", "where", "said"),
    [
        ("settings.matchr", {}, "matchr", "matcher, rows, balance, clean"),
        ("settings.matcher.penalty_smal", 3, "matcher.penalty_smal", "penalty_small"),
        ("settings.matcher.kind", "cenus", "matcher", "census"),
        ("settings.matcher.quality", "finest", "matcher.quality", "'fast' or 'fine'"),
        ("settings.matcher.penalty_small", "9", "matcher.penalty_small", "int"),
        ("settings.matcher.agreement_px", "nan", "agreement_px", "0 or more"),
        ("settings.matcher.speckle_pixels", -1, "speckle_pixels", "0 or more"),
        ("settings", None, "settings", "an object"),
        ("schema", 7, "schema", "1"),
    ],
)
def test_a_mistake_in_the_file_is_named(tuned, capsys, tmp_path, path, value, where, said):
    file = json.loads(tuned.read_text())
    *parts, last = path.split(".")
    place = functools.reduce(dict.__getitem__, parts, file)
    place[last] = value
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps(file))
    status = 3 if where in ("agreement_px", "speckle_pixels") else 2
    error = told(capsys, "evaluate", "disparity", ROOM[0], "--settings", wrong, status=status)[
        "error"
    ]
    assert (error["path"], error["where"]) == (str(wrong), where)
    assert said in error["want"]


def test_the_same_command_goes_on(tuned, capsys):
    before = json.loads(tuned.read_text())
    journal = tuned.with_name("settings.trials.jsonl")
    lines = journal.read_bytes().count(b"\n")
    report = told(capsys, "tune", *ROOM, *SMALL, "--out", tuned, "--candidates", 40)
    assert report["restored"] == report["trials"] == lines - 1
    assert json.loads(tuned.read_text()) == before
    error = told(capsys, "tune", *ROOM, *SMALL, "--out", tuned, "--seed", 7, status=2)["error"]
    assert (error["code"], error["where"]) == ("OutputSettings", "seed")
    assert json.loads(tuned.read_text()) == before


@pytest.mark.slow
def test_pairs_alone_find_what_is_better_by_truth(capsys, tmp_path):
    out = tmp_path / "blind.json"
    line = ("tune", *ROOM, *SMALL, "--by", "pairs", "--candidates", 30, "--seed", 1)
    report = told(capsys, *line, "--out", out)
    assert (report["by"], report["improved"]) == ("pairs", True)
    assert report["held_best"]["d1_est"] is None
    assert report["loss_held"] <= 0.95
    other = ("synthetic:room:2", "--source.seed", "9", "--source.width-px", "320")
    first = told(capsys, "evaluate", "disparity", *other)
    best = told(capsys, "evaluate", "disparity", *other, "--settings", out)
    assert best["epe"] < first["epe"]
    assert best["d1_filled"] < first["d1_filled"] + 0.001


@pytest.mark.slow
def test_pairs_alone_bring_sgbm_nearer_to_the_truth(capsys, tmp_path):
    """Nearer on average; which settings have fewer outliers pairs do not tell for SGBM."""
    room = ("synthetic:room:10", "--source.seed", "11", "--source.width-px", "320")
    line = ("tune", *room, "--matcher", "sgbm", "--by", "pairs", "--candidates", 60)
    report = told(capsys, *line, "--budget", "20m", "--out", tmp_path / "blind.json")
    assert (report["by"], report["improved"]) == ("pairs", True)
    assert any("hardly tell outliers of SGBM" in each for each in report["warnings"])
    other = ("synthetic:room:4", "--source.seed", "30", "--source.width-px", "640")
    first = told(capsys, "evaluate", "disparity", *other, "--matcher", "sgbm")
    best = told(capsys, "evaluate", "disparity", *other, "--settings", tmp_path / "blind.json")
    assert best["epe"] < 0.8 * first["epe"]
    assert best["d1_filled"] < first["d1_filled"] + 0.001
    assert best["density"] > first["density"] - 0.01


def test_a_stopped_search_keeps_the_best_and_goes_on(capsys, tmp_path):
    out, journal = tmp_path / "s.json", tmp_path / "s.trials.jsonl"
    line = ["tune", *ROOM, *SMALL, "--out", str(out)]
    child = subprocess.Popen(
        [sys.executable, "-m", "pseudolidar.cli", *line], stderr=subprocess.PIPE, text=True
    )
    while not (journal.exists() and journal.read_bytes().count(b"\n") > 12):
        assert child.poll() is None, child.stderr.read()
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=120)
    assert child.returncode == 130
    assert f"the best so far is in {out}" in said
    assert set(json.loads(out.read_text())["settings"]) == {"matcher", "smooth", "fill"}
    report = told(capsys, *line, "--candidates", 20)
    assert report["restored"] >= 12
    assert report["candidates"] >= 20


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (("--budget", "soon"), 2, "300s"),
        (("--budget", "0s"), 2, "300s"),
        (("--keep", "matcher.speed"), 2, "matcher.quality"),
        (("--tune-frames", "0"), 2, "1 or more"),
        (("--seed", "-1"), 2, "0 or more"),
        (("--matcher", "sgbm", "--keep", "matcher.quality"), 2, "matcher.mode"),
        (("--source.width-px", "70", "--matcher.disparities", "96"), 3, "at most 64"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, status, said, capsys, tmp_path):
    out = tmp_path / "s.json"
    line = ("tune", "synthetic:room:2", "--source.width-px", "128", *arguments, "--out", out)
    error = told(capsys, *line, status=status)["error"]
    assert said in f"{error['want']} {error['fix']}"
    assert not out.exists()


def test_no_file_of_anybody_else_is_written_over(capsys, tmp_path):
    out = tmp_path / "s.json"
    out.write_text("mine")
    line = ("tune", *ROOM, *SMALL, "--candidates", 1, "--out", out)
    assert told(capsys, *line, status=2)["error"]["path"] == str(out)
    assert out.read_text() == "mine"
    told(capsys, *line, "--overwrite")
    assert json.loads(out.read_text())["schema"] == 1
    assert told(capsys, *line[:-1], tmp_path, status=2)["error"]["got"] == "a folder"
    # A picture is drawn anew only where it is of trials.
    photo = tmp_path / "photo.png"
    photo.write_bytes(b"\x89PNG, mine")
    again = (*line, "--picture", photo)
    assert "picture of trials" in told(capsys, *again, status=2)["error"]["got"]
    assert photo.read_bytes() == b"\x89PNG, mine"
    drawn = (*line, "--picture", tmp_path / "trials.png")
    told(capsys, *drawn)
    told(capsys, *drawn)


def test_pictures_that_cannot_be_read_are_told(capsys, tmp_path):
    pairs = tmp_path / "pairs"
    scene = ["--world", "room", "--layout", "object", "--frames", "4", "--width-px", "200"]
    assert main(["synth", str(pairs), *scene]) == 0
    broken = next(pairs.rglob("image_2/*1.png"))
    broken.write_bytes(broken.read_bytes()[:900])
    capsys.readouterr()
    line = ("tune", pairs, *SMALL, "--candidates", 1, "--out")
    found = told(capsys, *line, tmp_path / "s.json", "--no-check", status=4)
    assert [each["id"] for each in found["skipped"]] == [broken.stem]
    assert main([*map(str, line), str(tmp_path / "t.json"), "--no-check"]) == 4
    assert f"left out: {broken.stem}: ImageTruncated" in capsys.readouterr().out
