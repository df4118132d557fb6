"""`obstacles --view`: a page on what a run finds, while it finds it; the run writes the same."""

from __future__ import annotations

import contextlib
import csv
import os
import pty
import re
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Page

from pseudolidar.formats.obstacle_json import read_obstacles
from pseudolidar.pipelines import obstacles as pipeline
from pseudolidar.running.products.corridor_table import APPROACH
from pseudolidar.running.products.found import found_name
from pseudolidar.running.products.found_clouds import FoundOutputs
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.found_in_order import FoundInOrder
from pseudolidar.viewer.objects.teller import Wish
from pseudolidar.viewer.objects.watch import ObjectWatch
from tests.pipelines.conftest import write_drive
from tests.pipelines.test_convert_interrupted import tree
from tests.pipelines.test_obstacles_interrupted import boxes as boxes
from tests.pipelines.test_obstacles_interrupted import job
from tests.viewer.seen import screenshot

FRAMES = 7


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_drive(tmp_path_factory.mktemp("drive") / "tiny", frames=FRAMES)


class Everything:
    """Who looks on at every frame, as no page does."""

    def __init__(self) -> None:
        self.seen: list[FoundInOrder] = []

    def show(self, _number: int, what: FoundInOrder) -> None:
        self.seen.append(what)


@pytest.fixture(scope="module")
def looking() -> Iterator[Everything]:
    """Looks on at every run that has a page."""
    everything = Everything()

    @contextlib.contextmanager
    def all_seen(task, _source, _moment, *, finds) -> Iterator[Everything | None]:
        assert finds
        yield everything if task.view else None

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(pipeline, "run_page", all_seen)
        yield everything


@pytest.fixture(scope="module")
def seen(
    drive: Path, boxes: Path, looking: Everything, tmp_path_factory: pytest.TempPathFactory
) -> tuple[pipeline.Obstacles, list[FoundInOrder]]:
    """A run, and what was seen of it."""
    out = tmp_path_factory.mktemp("seen") / "out"
    task = job(drive, out, boxes, view=True, video=False, to=FoundOutputs.parse("pcd"))
    assert pipeline.run(task).exit_code == 0
    assert len(looking.seen) == FRAMES
    return task, list(looking.seen)


def rows_of(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "corridor.csv").open()))


def same_approach(frame: FoundInOrder, row: dict[str, str]) -> bool:
    """As a row of the table tells it, in its six digits."""
    told = [None] * len(APPROACH) if frame.approach is None else vars(frame.approach).values()
    return ["" if one is None else f"{one:.6g}" for one in told] == [row[key] for key in APPROACH]


def test_what_is_shown_is_what_the_tables_tell(
    seen: tuple[pipeline.Obstacles, list[FoundInOrder]], tmp_path: Path
):
    task, frames = seen
    plain = replace(task, out=tmp_path / "plain", view=False)
    assert pipeline.run(plain).exit_code == 0
    assert tree(plain.out) == tree(task.out)
    told = read_obstacles(task.out / "obstacles.jsonl")
    rows = rows_of(task.out)
    watch = ObjectWatch(None, {}, lambda _index: None)
    watch.ask(Wish(of_run=True))
    assert not watch.scene(Moment("", 0)).text  # before the first frame there is nothing to say
    assert len({row["closing_m_s"] for row in rows}) > FRAMES - 3  # the first two tell none
    for frame, row in zip(frames, rows, strict=True):
        assert same_approach(frame, row)
        moment = pipeline.moment_of(frame)
        scene = watch.scene(moment)
        assert [one.obstacle.distance_m for one in scene.objects] == pytest.approx(
            [one.distance_m for one in told[moment.id]]
        )
        assert [one.name for one in scene.objects] == [
            f"Car {one.track.track_id}" for one in told[moment.id] if one.track is not None
        ]
        assert [one.obstacle.coasts for one in scene.objects] == [
            one.coasts for one in told[moment.id]
        ]
        assert scene.corridor is not None
        assert (scene.corridor.nearest_m is not None) == (row["state"] == "thing")
        assert (row["contact_s"] != "") == ("reached in" in scene.corridor.text)
        assert bool(len(scene.xyz)) == any(not one.coasts for one in told[moment.id])
        assert "stereo" in moment.clouds
        assert "object" in moment.clouds["stereo"].extra
    watch.ask(Wish())
    assert not watch.scene(moment).objects
    assert watch.scene(moment).corridor is None
    watch.close()


def test_frames_that_are_done_again_are_shown_as_in_the_tables_of_all(
    seen: tuple[pipeline.Obstacles, list[FoundInOrder]], looking: Everything
):
    task, _ = seen
    rows, again = rows_of(task.out), (3, FRAMES - 1)
    for index in again:
        (task.out / found_name(f"{index:06d}")).unlink()
    looking.seen.clear()
    assert pipeline.run(task).exit_code == 0
    assert rows_of(task.out) == rows
    assert [frame.found.frame.index for frame in looking.seen] == list(again)
    for frame in looking.seen:
        assert frame.approach is not None
        assert same_approach(frame, rows[frame.found.frame.index])


def test_somebody_at_a_terminal_looks_at_a_run_to_its_end(
    drive: Path, boxes: Path, tmp_path: Path, page: Page
):
    """A real terminal, a real browser: the list, the boxes; Ctrl-C ends it."""
    out = tmp_path / "out"
    command = [
        sys.executable, "-m", "pseudolidar.cli", "obstacles", drive, out, "--detector",
        f"regions:{boxes}", "--track", "tracker", "--corridor", "2x2x30", "--ground", "none",
        "--view", "--port", "0",
    ]  # fmt: skip
    master, slave = pty.openpty()
    run = subprocess.Popen(map(str, command), stdin=slave, stdout=slave, stderr=slave)
    os.close(slave)
    said = Said(master)
    try:
        page.goto(said.wait_for(r"http://\S+token=\S+"))
        page.get_by_text(f"frame {FRAMES} of {FRAMES}").wait_for(timeout=60_000)
        said.wait_for("stays open until Ctrl-C")
        page.get_by_text("The run has ended").wait_for(timeout=60_000)
        rows = page.frame_locator('iframe[title="Obstacles"]').locator("tbody tr")
        (last,) = read_obstacles(out / "obstacles.jsonl")[f"{FRAMES - 1:06d}"]
        rows.get_by_text("Car 1").wait_for(timeout=60_000)
        assert f"{last.distance_m:.1f} ±" in rows.nth(0).inner_text()
        assert page.get_by_label("Watch a corridor").count() == 0  # the run watches, or does not
        screenshot(page, "obstacles_run")
    finally:
        run.send_signal(signal.SIGINT)
        code = run.wait(timeout=60)
        said.close()
    assert code == 0


class Said:
    """What a program says at its terminal."""

    def __init__(self, master: int) -> None:
        self._master, self._text = master, ""
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # the program has ended
            while not self._ended.is_set():
                if select.select([self._master], [], [], 0.1)[0]:
                    self._text += os.read(self._master, 65536).decode()

    def wait_for(self, pattern: str) -> str:
        deadline = time.monotonic() + 60
        while not (found := re.search(pattern, self._text)):
            assert time.monotonic() < deadline, self._text
            time.sleep(0.02)
        return found.group()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self._master)
