"""Checkpoints that are read, and those that are not."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pseudolidar.mapping.loops import LoopFinder
from pseudolidar.mapping.odometry import Vision
from pseudolidar.mapping.place_store import PlaceFile
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.mapped import checkpoints
from pseudolidar.running.mapped.checkpoints import CHECKPOINT_FILE, Checkpoints, due
from pseudolidar.running.mapped.state_file import encode_state
from pseudolidar.running.mapped.stored import PLACES_FILE
from pseudolidar.running.mapped.walk import Walk
from pseudolidar.sources.synthetic import Synthetic

SETTINGS: Mapping[str, Any] = {"version": "1", "matcher": "census"}
CREW = CrewPlan(1, 7.0)


class SyncedBefore(PlaceFile):
    """Places that must be durable when a checkpoint says so."""

    synced = 0

    def sync(self) -> None:
        assert self._path.exists()
        assert not (self._path.parents[1] / CHECKPOINT_FILE).exists()
        super().sync()
        self.synced += 1


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A folder with a checkpoint after three frames, and their ids."""
    folder = tmp_path_factory.mktemp("made")
    source = Synthetic("street", frames=3, width_px=240, height_px=96).open()
    with pytest.MonkeyPatch.context() as patch, SyncedBefore(folder / PLACES_FILE) as places:
        patch.setattr(checkpoints, "EVERY", 3)
        loops = LoopFinder(apart_m=1.0, similarity=0.0).start(source.rig, places)
        walk = Walk(Vision().start(source.rig), source.rig, loops)
        written = Checkpoints(folder, SETTINGS, places, drawn=False, crew=CREW)
        for index in range(3):
            frame = source.load(index)
            walk.step(frame, frame.truth, [])
            walk = written.after(walk)
        assert places.synced == 1
    assert (folder / PLACES_FILE).stat().st_size > 0
    return folder, [one.id for one in walk.placed]


@pytest.fixture
def ids(made: tuple[Path, list[str]], tmp_path: Path) -> list[str]:
    """Of frames; their checkpoint is copied."""
    for name in (CHECKPOINT_FILE, PLACES_FILE):
        copy = tmp_path / name
        copy.parent.mkdir(exist_ok=True)
        copy.write_bytes((made[0] / name).read_bytes())
    return made[1]


def last(
    folder: Path,
    ids: list[str],
    *,
    committed: list[str] | None = None,
    decided_by: Mapping[str, Any] = SETTINGS,
    drawn: bool = False,
) -> Walk | None:
    crews = []

    def expected(_per_frame: Any, *, crew: CrewPlan | None = None) -> tuple[str, ...]:
        crews.append(crew)
        return tuple(ids)

    committed = ids if committed is None else committed
    run: Any = SimpleNamespace(expected=expected, committed=frozenset(committed))
    with PlaceFile(folder / PLACES_FILE) as places:
        found = Checkpoints(folder, decided_by, places, drawn=drawn, crew=CREW).last(run, len)
    assert crews in ([], [CREW])  # frames that failed are tried as others are
    assert found is None or crews
    return found


def test_the_last_one_is_read(tmp_path: Path, ids: list[str]):
    walk = last(tmp_path, [*ids, "later"])
    assert walk is not None
    assert [one.id for one in walk.placed] == ids


def test_that_of_other_settings_is_not(tmp_path: Path, ids: list[str]):
    assert last(tmp_path, ids, decided_by={**SETTINGS, "version": "2"}) is None


def test_that_of_other_sources_is_not(
    tmp_path: Path,
    ids: list[str],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
):
    caplog.set_level("INFO")
    package = tmp_path / "package"
    (package / "mapping").mkdir(parents=True)
    (package / "mapping" / "odometry.py").write_text("")
    monkeypatch.setattr(checkpoints, "PACKAGE", package)
    assert last(tmp_path, ids) is None
    assert "from the first one" in caplog.text


def test_that_of_other_frames_is_not(tmp_path: Path, ids: list[str]):
    assert last(tmp_path, ["mended", *ids]) is None
    assert last(tmp_path, ids, committed=ids[:-1]) is None
    assert last(tmp_path, ids, drawn=True) is None


@pytest.mark.parametrize("name", [CHECKPOINT_FILE, PLACES_FILE])
@pytest.mark.parametrize("how", ["cut", "changed", "gone"])
def test_a_damaged_one_is_not(tmp_path: Path, ids: list[str], name: str, how: str):
    file = tmp_path / name
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 0x55
    if how == "gone":
        file.unlink()
    else:
        file.write_bytes(data[: len(data) // 2] if how == "cut" else data)
    assert last(tmp_path, ids) is None


@pytest.mark.parametrize("field", ["placed", "_loops"])
def test_a_state_that_lacks_something_is_not(tmp_path: Path, ids: list[str], field: str):
    walk = last(tmp_path, ids)
    assert walk is not None
    walk._loops = None
    delattr(walk, field)
    data = encode_state(walk, {})
    head = json.loads((tmp_path / CHECKPOINT_FILE).read_bytes().partition(b"\n")[0])
    head["sha256"] = hashlib.sha256(data).hexdigest()
    (tmp_path / CHECKPOINT_FILE).write_bytes(json.dumps(head).encode() + b"\n" + data)
    assert last(tmp_path, ids) is None


def test_a_walk_without_loops_needs_no_file_of_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(checkpoints, "EVERY", 1)
    source = Synthetic("street", frames=1, width_px=240, height_px=96).open()
    walk, frame = Walk(Vision().start(source.rig), source.rig), source.load(0)
    walk.step(frame, frame.truth, [])
    written = Checkpoints(tmp_path, SETTINGS, None, drawn=False, crew=CREW)
    assert len(written.after(walk).placed) == 1
    assert not (tmp_path / PLACES_FILE).exists()
    run: Any = SimpleNamespace(
        expected=lambda _per_frame, crew: (frame.id,), committed=frozenset([frame.id])
    )
    again = written.last(run, len)
    assert again is not None
    assert [one.id for one in again.placed] == [frame.id]


def test_long_walks_are_written_less_often():
    written = [frames for frames in range(1, 20_001) if due(frames)]
    assert written[:20] == list(range(50, 1001, 50))
    shares = [later / at for at, later in itertools.pairwise(written[20:])]
    assert min(shares) > 1.045
    assert max(shares) <= 1.05
