"""obstacles with every output, killed at many moments: at the end is there what always is."""

from __future__ import annotations

import contextlib
import random
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import av
import pytest
from pseudolidar.pipelines.obstacles import Obstacles, run

from pseudolidar.formats.obstacle_json import read_obstacles
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.regions import Boxes, Regions
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.running.products.found_clouds import FoundOutputs
from pseudolidar.sources.recognise import recognise
from tests.pipelines.conftest import write_drive
from tests.pipelines.test_convert_interrupted import (
    CHILDREN,
    journal_lines,
    tree,
    wait_for,
)

FILM = "obstacles.mp4"
FRAMES, HIDDEN = 7, (4, 5)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few small pairs."""
    return write_drive(tmp_path_factory.mktemp("drive") / "tiny", frames=FRAMES)


@pytest.fixture(scope="module")
def boxes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of something in the middle of the picture that is not seen in two frames."""
    path = tmp_path_factory.mktemp("boxes") / "boxes.csv"
    rows = [f"{n:06d},40,20,80,50,Car" for n in range(60) if n not in HIDDEN]
    path.write_text("frame,left,top,right,bottom,class\n" + "\n".join(rows) + "\n")
    return path


def job(source: Path, out: Path, boxes: Path, *, workers: int = 2, **options) -> Obstacles:
    everything = {
        "to": FoundOutputs.parse("pcd,mcap,kitti"),
        "detector": Regions(Boxes(boxes)),
        "track": Tracker(),
        "corridor": Corridor.parse("2x2x30"),
        "near": 6.0,
        "video": True,
        "ground": None,
    }
    return Obstacles(recognise(str(source)), out, workers=workers, **everything | options)


@pytest.fixture(scope="module")
def whole(drive, boxes, tmp_path_factory) -> dict[str, bytes]:
    """What an uninterrupted run with one worker writes."""
    out = tmp_path_factory.mktemp("whole") / "out"
    assert run(job(drive, out, boxes, workers=1)).exit_code == 0
    found = read_obstacles(out / "obstacles.jsonl")
    coasting = [name for name, obstacles in found.items() if obstacles[0].coasts]
    assert coasting == [f"{number:06d}" for number in HIDDEN]
    assert len(found) == frames_in_film(out) == FRAMES
    return tree(out)


def frames_in_film(out: Path) -> int:
    with av.open(str(out / FILM)) as film:
        return sum(1 for _ in film.decode(video=0))


def killed_when(task: Obstacles, there: Callable[[], bool]) -> None:
    """Kill a process as soon as something is there; it may be done before that."""
    child = CHILDREN.Process(target=run, args=(task,))
    child.start()
    wait_for(lambda: there() or not child.is_alive())
    child.kill()
    child.join()
    assert child.exitcode in (0, -signal.SIGKILL)


def test_killed_at_any_moment_it_ends_with_the_same_bytes(drive, boxes, whole, tmp_path) -> None:
    out = tmp_path / "out"
    task = job(drive, out, boxes)
    killed_when(task, lambda: journal_lines(out) > 5)  # a track coasts then
    committed = {name: data for name, data in tree(out).items() if name in whole}
    killed_when(task, lambda: any(out.glob(f"{FILM}.*.tmp")))  # the film is half written
    killed_when(task, lambda: (out / FILM).exists())
    assert committed == {name: tree(out)[name] for name in committed}
    report = run(task)
    assert report.exit_code == 0
    assert report.result.passed_now < FRAMES
    assert tree(out) == whole


def test_a_film_of_other_frames_or_half_of_one_is_made_again(drive, boxes, whole, tmp_path) -> None:
    out = tmp_path / "out"
    stopped = run(job(drive, out, boxes, stop_at=6.0))
    assert (stopped.exit_code, frames_in_film(out)) == (10, 1)
    part = (out / FILM).read_bytes()
    assert run(job(drive, out, boxes)).exit_code == 0
    assert tree(out) == whole
    for damaged in (part, whole[FILM][:-1]):
        (out / FILM).write_bytes(damaged)  # as a kill before the new film leaves the old one
        assert run(job(drive, out, boxes)).result.passed_now == 0
        assert tree(out) == whole
    before = (out / FILM).stat().st_mtime_ns
    run(job(drive, out, boxes))
    assert (out / FILM).stat().st_mtime_ns == before


@pytest.mark.slow
def test_frames_whose_files_are_lost_are_done_again_with_the_same_tracks(
    drive, boxes, whole, tmp_path
) -> None:
    out = tmp_path / "out"
    task = job(drive, out, boxes)
    run(task)
    (out / ".obstacles" / "000002.json").write_bytes(b"{}")
    (out / ".pictures" / "000005.jpg").unlink()
    (out / "obstacles.jsonl").unlink()
    assert run(task).result.passed_now == 2
    assert tree(out) == whole


@pytest.mark.slow
def test_the_command_killed_at_random_ends_with_the_same_bytes(boxes, tmp_path) -> None:
    drive = write_drive(tmp_path / "long", frames=40)

    def command(out: Path, *options: str) -> list[str]:
        line = [sys.executable, "-m", "pseudolidar.cli", "obstacles", str(drive), str(out)]
        line += ["--to", "pcd,mcap,kitti", "--mcap.profile", "ros2", "--track", "tracker"]
        line += ["--detector", f"regions:{boxes}", "--corridor", "2x2x30", "--near", "6"]
        return [*line, "--ground", "none", "--video", *options]

    whole, out, chance = tmp_path / "whole", tmp_path / "out", random.Random(3)
    subprocess.run(command(whole, "--workers", "1"), check=True, stdout=subprocess.DEVNULL)
    for _ in range(8):
        lines = journal_lines(out)
        child = subprocess.Popen(command(out), stdout=subprocess.DEVNULL)
        wait_for(lambda: journal_lines(out) > lines or child.poll() is not None)  # noqa: B023
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(chance.uniform(0.0, 0.4))
        child.kill()
        child.wait()
    assert subprocess.run(command(out), stdout=subprocess.DEVNULL).returncode == 0
    assert tree(out) == tree(whole)
    assert frames_in_film(out) == 40
