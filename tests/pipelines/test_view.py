"""The verb `view`: how it ends, and what it refuses before it serves anything."""

import json
import os
import signal
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.view import View

from pseudolidar.cli import main
from pseudolidar.errors import UsageError
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.formats.tum import write_tum_trajectory
from pseudolidar.running.describing.describe import describe
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.settings_json import from_json, to_json
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.address import Port
from pseudolidar.viewer.opening import RUN_FILE


def test_ctrl_c_is_the_ordinary_way_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    opened: list[str] = []

    def pressed(url: str) -> None:
        opened.append(url)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(webbrowser, "open", pressed)
    assert main(["view", "--port", "0", "--named", "robot.lan"]) == 0
    told = capsys.readouterr()
    assert told.err.splitlines() == opened
    assert told.out.strip() == ""


def test_programs_are_told_what_was_opened_and_where_but_no_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    urls: list[str] = []

    def pressed(url: str) -> None:
        urls.append(url)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(webbrowser, "open", pressed)
    write_ply(tmp_path / "a.ply", PointCloud(np.eye(3, dtype=np.float32), "map"))
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = (0, 1, 3)
    write_tum_trajectory(tmp_path / "b.tum", [0, 1, 2], poses)
    paths = ["synthetic:street", str(tmp_path / "a.ply"), str(tmp_path / "b.tum")]
    assert main(["view", *paths, "--frames", "0:2", "--port", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    street = told["opened"].pop(0)
    assert (street["kind"], street["frames"]) == ("sequence", 2)
    assert "synthetic street" in street["name"]
    assert told == {
        "file": None,
        "address": urls[0].partition("?")[0],
        "opened": [
            {"name": "a.ply", "kind": "cloud", "points": 3},
            {"name": "b.tum", "kind": "path", "poses": 3, "length_m": 3.0},
        ],
    }


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--share"], "ssh -L 8080:localhost:8080"),
        (["--share", "--port", "9000"], "ssh -L 9000:localhost:9000"),
        (["--share", "--port", "auto"], "ssh -L PORT:localhost:PORT"),
        (["--named", "robot.lan:8080"], "without port"),
        (["--named", "http://robot"], "without port"),
        (["--named", ""], "without port"),
    ],
)
def test_what_is_not_safe_is_refused(
    flags: list[str], said: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["view", *flags]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("port", ["99999", "65536", "-1", "8o", "٣", "", "9" * 10_000])
def test_a_port_that_is_none_is_named_with_those_that_are(
    port: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["view", f"--port={port}"]) == 2
    assert "--port: " in (said := capsys.readouterr().err)
    assert "wanted 0 to 65535" in said


def test_ports_are_settings_as_others_are():
    assert Port.parse("auto") == Port.parse("0") == 0
    job = View(port=Port.parse("65535"))
    assert from_json(View, to_json(job)) == job
    with pytest.raises(UsageError, match="65535"):
        from_json(View, {"port": -1})


@pytest.mark.parametrize("name", ["a.html", "a.viser", "a.mp4", "a.png"])
def test_no_file_is_made_of_nothing(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, empty = tmp_path / "out", tmp_path / "empty.ply"
    out.mkdir()
    write_ply(empty, PointCloud(np.zeros((0, 3), np.float32), "map"))
    assert main(["view", "--export", str(out / name)]) == 2
    assert "UsageError: --export: no path" in capsys.readouterr().err
    assert main(["view", str(empty), "--export", str(out / name)]) == 3
    assert "CloudEmpty: nothing that could be seen" in capsys.readouterr().err
    torn = tmp_path / "clouds"
    torn.mkdir()
    (torn / "1.ply").write_bytes(empty.read_bytes().replace(b"vertex 0", b"vertex 1"))
    assert main(["view", str(torn), "--export", str(out / name)]) == 3
    assert "nothing that could be seen: PointFileTruncated" in capsys.readouterr().err
    assert not list(out.iterdir())


def test_ctrl_c_during_an_export_leaves_nothing_and_promises_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"
    out.mkdir()
    write_ply(tmp_path / "a.ply", PointCloud(np.eye(3, dtype=np.float32), "map"))
    monkeypatch.setattr(FrameProgress, "advance", lambda *_: os.kill(os.getpid(), signal.SIGINT))
    for name in ("big.mp4", "big.html"):
        assert main(["view", str(tmp_path / "a.ply"), "--export", str(out / name)]) == 130
        said = capsys.readouterr().err
        assert f"{name} was not written; the same command begins anew" in said
        assert "continues" not in said
    assert not list(out.iterdir())


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "[]", '{"settings": 3}', '{"settings": {}}'])
def test_a_run_whose_settings_cannot_be_read_has_no_source(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, text: str
):
    (tmp_path / RUN_FILE).write_text(text)
    assert View().reel_of_run(tmp_path) is None
    assert "its source cannot be opened" in caplog.text
    described = describe(str(tmp_path))
    assert "cannot be read" in str(described.unknown)
