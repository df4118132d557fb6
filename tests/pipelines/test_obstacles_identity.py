"""What a run of obstacles goes on with: the content of files that it is given, not their place."""

from __future__ import annotations

import hashlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from pseudolidar.pipelines.obstacles import Obstacles, opened

from pseudolidar.cli import main
from pseudolidar.obstacles.onnx_detector import OnnxDetector
from pseudolidar.obstacles.regions import Boxes, Regions
from pseudolidar.obstacles.template import Template
from pseudolidar.running.journal.identity import identity
from pseudolidar.running.journal.journal_file import JOURNAL_NAME
from pseudolidar.sources.recognise import recognise
from tests.obstacles import detector_graphs as graphs

FRAMES = 24
TABLES = ("obstacles.jsonl", "obstacles.csv")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PSEUDOLIDAR_CACHE_DIR", str(tmp_path / "cache"))


def network(path: Path, *, score: float = 0.9) -> Path:
    """YOLOX that sees a car in the middle of every picture of the drive, its names beside it."""
    path.parent.mkdir(exist_ok=True)
    outputs = graphs.yolox()
    outputs["output"][..., 4] *= score / 0.9
    path.with_suffix(".names").write_text("\n".join(graphs.CLASSES))
    return graphs.written(path, outputs)


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def command(drive: Path, out: Path, file: Path) -> list[str]:
    job = ["obstacles", str(drive), str(out), "--detector", f"onnx:{file}"]
    return [*job, "--workers", "1", "--frames", f":{FRAMES}", "--no-check"]


def test_a_stopped_run_goes_on_with_the_same_network_wherever_it_lies(
    long_drive, tmp_path, capsys
) -> None:
    first, out = network(tmp_path / "a" / "net.onnx"), tmp_path / "out"
    program = [sys.executable, "-m", "pseudolidar.cli"]
    child = subprocess.Popen([*program, *command(long_drive, out, first)], stderr=subprocess.PIPE)
    journal, deadline = out / JOURNAL_NAME, time.monotonic() + 60
    while not (journal.exists() and journal.read_bytes().count(b"\n") > 1):
        assert child.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.002)
    child.send_signal(signal.SIGINT)
    child.communicate()
    assert child.returncode == 130
    assert not (out / TABLES[0]).exists()  # it was on the way
    assert (out / "report.html").exists()  # of the frames so far
    moved = network(tmp_path / "b" / "other.onnx")
    assert sha256(moved) == sha256(first)
    job = command(long_drive, out, moved)
    done = subprocess.run([*program, *job, "--json"], capture_output=True, check=True)
    told = json.loads(done.stdout)
    assert told["passed_now"] < told["committed"] == FRAMES, "committed frames were done again"
    assert f"sha256 {sha256(first)[:12]}, licence: not said".encode() in done.stderr
    assert told["networks"]["detector"]["sha256"] == sha256(first)
    own_ms = told["networks"]["detector"]["median_ms"]
    assert 0 < own_ms < 1e3 * told["times"]["seconds"]
    assert f"{own_ms:.1f} ms a frame on cpu" in (out / "report.html").read_text()
    whole = command(long_drive, tmp_path / "whole", first)
    assert main(whole) == 0
    for name in TABLES:
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    # Another network under the name that the run began with is another run.
    before, now = sha256(first), sha256(network(first, score=0.8))
    capsys.readouterr()
    assert main(command(long_drive, out, first)) == 2
    said = capsys.readouterr().err
    assert before in said
    assert now in said


def of(drive: Path, detector, **others) -> dict:
    job = Obstacles(recognise(str(drive)), detector=detector, **others)
    return identity(job, opened(job))


def test_files_count_by_their_content(drive, tmp_path) -> None:
    """Template, regions, names and rig, each elsewhere and changed."""
    for folder in ("a", "b", "c"):
        (tmp_path / folder).mkdir()
        noise = np.random.default_rng(folder == "c")
        cv2.imwrite(str(tmp_path / folder / "t.png"), noise.integers(0, 256, (20, 20, 3), np.uint8))
        edge = 30 if folder == "c" else 40
        (tmp_path / folder / "r.csv").write_text(f"left,top,right,bottom\n1,2,{edge},40\n")
        rig = json.loads((drive / "rig.json").read_text())
        rig["baseline_m"] += 0.1 * (folder == "c")
        (tmp_path / folder / "rig.json").write_text(json.dumps(rig))
        network(tmp_path / folder / "n.onnx")
        names = ["cat" if folder == "c" else "car", *graphs.CLASSES[1:]]
        (tmp_path / folder / "list.names").write_text("\n".join(names))
    here, there, other = (
        {
            "template": of(drive, Template(tmp_path / folder / "t.png")),
            "regions": of(drive, Regions(Boxes(tmp_path / folder / "r.csv"))),
            "also": of(drive, None, also=Template(tmp_path / folder / "t.png")),
            "rig": of(drive, None, rig=tmp_path / folder / "rig.json"),
            "names": of(
                drive,
                OnnxDetector(tmp_path / folder / "n.onnx", names=tmp_path / folder / "list.names"),
            ),
        }
        for folder in ("a", "b", "c")
    )
    assert here == there
    for what, settings in here.items():
        assert settings != other[what], what
        assert str(tmp_path) not in json.dumps(settings), what
