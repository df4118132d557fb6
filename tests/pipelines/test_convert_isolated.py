"""Conversion by processes: the same bytes as by threads, whatever happens to them."""

import json
import os
import random
import signal
import subprocess
import sys
import time

import psutil
import pytest

from pseudolidar.cli import main
from pseudolidar.running.crew.in_flight import IN_FLIGHT_NAME, left_by_the_last_run

ALL = "pcd,ply,bin,npz,disparity,depth,mcap"
OF_THE_RUN = {"run.json", "report.json", "report.html", "journal.jsonl"}


def tree(folder):
    files = {str(p.relative_to(folder)): p for p in folder.rglob("*") if p.is_file()}
    return {name: p.read_bytes() for name, p in files.items() if name not in OF_THE_RUN}


def children(process):
    return [p for p in psutil.Process(process.pid).children(recursive=True) if p.is_running()]


def wait_for(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def started(source, out, *options):
    line = ["convert", str(source), str(out), "--to", "pcd,mcap", *options]
    return subprocess.Popen(
        [sys.executable, "-m", "pseudolidar.cli", *line], stdout=subprocess.PIPE, text=True
    )


def lines_of(journal):
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


@pytest.fixture(scope="module")
def reference(long_drive, tmp_path_factory):
    out = tmp_path_factory.mktemp("reference")
    assert main(["convert", str(long_drive), str(out), "--to", "pcd,mcap"]) == 0
    return tree(out)


def test_processes_write_what_threads_write(drive, tmp_path):
    for name, options in (("threads", []), ("processes", ["--isolate", "--workers", "3"])):
        line = ["convert", str(drive), str(tmp_path / name), "--to", ALL, *options]
        assert main(line) == 0
    assert tree(tmp_path / "processes") == tree(tmp_path / "threads")
    assert json.loads((tmp_path / "processes" / "run.json").read_text())["settings"]["isolate"]


def test_processes_that_are_killed_are_replaced(long_drive, tmp_path, reference):
    """By whatever: each frame is tried twice, so not often enough to hit one frame twice."""
    run = started(long_drive, tmp_path, "--isolate", "--workers", "2")
    chance = random.Random(2)
    for _ in range(3):
        before = lines_of(tmp_path / "journal.jsonl")
        wait_for(lambda before=before: lines_of(tmp_path / "journal.jsonl") > before + 4)
        chance.choice(children(run)).kill()
    run.communicate(timeout=60)
    assert run.returncode == 0
    assert tree(tmp_path) == reference


def test_ctrl_c_ends_it_and_its_processes_and_threads_may_go_on(long_drive, tmp_path, reference):
    run = started(long_drive, tmp_path, "--isolate", "--workers", "2")
    wait_for(lambda: lines_of(tmp_path / "journal.jsonl") > 5)
    hands = children(run)
    assert len(hands) == 2
    run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=5)
    assert run.returncode == 130
    assert "the same command continues" in out
    # orphans that ended stay until init looks
    assert psutil.wait_procs(hands, timeout=15)[1] == []
    assert main(["convert", str(long_drive), str(tmp_path), "--to", "pcd,mcap"]) == 0
    assert tree(tmp_path) == reference


@pytest.fixture
def endless(own_drive):
    """A drive with a picture that never comes: a pipe that nobody writes to. And what it was."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("needs a pipe with a name")
    path = own_drive / "left" / "000002.png"
    data = path.read_bytes()
    path.unlink()
    os.mkfifo(path)
    return path, data


@pytest.mark.parametrize("options", [("--timeout", "2"), ("--timeout", "8", "--isolate")])
def test_a_picture_that_never_comes_costs_its_frame(endless, own_drive, tmp_path, options, capsys):
    """The first frame of a process loads the kernels, within its time."""
    out = tmp_path / "out"
    begin_s = time.monotonic()
    code = main(["convert", str(own_drive), str(out), *options, "--json"])
    report = json.loads(capsys.readouterr().out)
    assert (code, report["committed"], report["skipped"]) == (4, 5, 1)
    (skip,) = json.loads((out / "report.json").read_text())["skipped"]
    assert (skip["id"], skip["code"]) == ("000002", "FrameTimeout")
    assert time.monotonic() - begin_s < 40


def test_a_run_that_died_is_told_of_with_its_frames(endless, own_drive, tmp_path, capfd):
    path, data = endless
    out = tmp_path / "out"
    run = started(own_drive, out, "--workers", "1")
    wait_for(lambda: left_by_the_last_run(out / IN_FLIGHT_NAME) == ("000002",))
    run.kill()
    run.communicate()
    path.unlink()
    path.write_bytes(data)
    assert main(["convert", str(own_drive), str(out), "--to", "pcd,mcap"]) == 0
    assert (
        "died while it did frame 000002; should it die again, --isolate" in capfd.readouterr().err
    )
    assert not (out / IN_FLIGHT_NAME).exists()
