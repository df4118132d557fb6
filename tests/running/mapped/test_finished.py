"""What a run told when it was done: given again to one that would do the same, and to no other."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pseudolidar.errors import OutputError
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.mapped.finished import FINISHED_FILE, Finished
from pseudolidar.running.mapped.walked import Walked
from pseudolidar.running.reports.map_report import MapReport
from pseudolidar.running.results import RunResult

SOURCE: Any = SimpleNamespace(lost=(), unpaired=())
FRAMES = (FrameRecord("0", 0), FrameRecord("1", 1))
DONE = RunResult(SOURCE, 2, FRAMES, 2, {"seconds": 1.0, "frames_per_s": 2.0})
ASKED = ["map.ply", {"voxel_m": 0.1}]


def run_in(folder: Path, *, result: RunResult | None = None, **others: Any) -> Any:
    """A run with nothing to do, unless `result` says otherwise."""
    now = replace(DONE, passed_now=0) if result is None else result
    source = SimpleNamespace(summary=SOURCE, ids=("0", "1"))
    told = {"folder": folder, "decided_by": {"version": "1"}, "source": source, **others}
    return SimpleNamespace(**told, result=lambda: now)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Of a run that is done: a map, and squares of it in a folder."""
    (tmp_path / "tiles").mkdir()
    files = [tmp_path / "map.ply", tmp_path / "tiles" / "0_0.ply"]
    for file in files:
        file.write_bytes(b"points")
    shown = (tmp_path / "map.ply", tmp_path / "tiles", tmp_path / "not made")
    report = MapReport(DONE, tmp_path, Walked(()), None, None, shown, {"points": 7})
    Finished(run_in(tmp_path), ASKED).keep(report)
    return tmp_path


def told(folder: Path, asked: Any = ASKED, **run: Any) -> Any:
    return Finished(run_in(folder, **run), asked).report()


def test_it_is_told_again_with_places_as_they_are_now(folder: Path, tmp_path: Path):
    moved = tmp_path / "moved"
    moved.mkdir()
    for file in ("map.ply", "tiles", FINISHED_FILE):
        (folder / file).rename(moved / file)
    again = told(moved)
    assert again.text().splitlines() == [
        "2 of 2 frames: the folder is already complete, nothing was done",
        "  map of 7 points",
        f"  {moved / 'map.ply'}",
        f"  {moved / 'tiles'}",
    ]
    facts = again.as_dict()
    assert facts["map"] == {"points": 7}
    assert (facts["out"], facts["passed_now"]) == (str(moved), 0)
    assert facts["files"] == [str(moved / "map.ply"), str(moved / "tiles")]
    assert again.exit_code == 0


@pytest.mark.parametrize(
    "other",
    [
        {"asked": ["map.ply", {"voxel_m": 0.2}]},
        {"decided_by": {"version": "2"}},
        {"source": SimpleNamespace(summary=SOURCE, ids=("0", "2"))},
        {
            "source": SimpleNamespace(
                summary=SimpleNamespace(lost=("3",), unpaired=()), ids=("0", "1")
            )
        },
        {"result": replace(DONE, records=FRAMES[:1])},
        {"result": replace(DONE, records=(*FRAMES[:1], FrameRecord("1", 1, skipped={})))},
    ],
)
def test_not_to_a_run_that_has_something_to_do(folder: Path, other: dict[str, Any]):
    assert told(folder) is not None
    assert told(folder, **other) is None


@pytest.mark.parametrize("name", ["map.ply", "tiles/0_0.ply"])
@pytest.mark.parametrize("data", [None, b"point", b"pointS"])
def test_not_where_a_file_is_not_as_it_was(folder: Path, name: str, data: bytes | None):
    (folder / name).unlink()
    if data is not None:
        (folder / name).write_bytes(data)
    assert told(folder) is None


def test_not_where_a_folder_leads_elsewhere(folder: Path):
    (folder / "tiles").rename(folder / "others")
    (folder / "tiles").symlink_to(folder / "others")
    assert told(folder) is None


@pytest.mark.parametrize(
    "changed",
    [
        b"",
        b"\xff",
        b"[]",
        b"[" * 100_000,
        {"whole": [{"name": "../map.ply", "size": 6, "crc32": 0}]},
        {"whole": [{"name": 3, "size": 6, "crc32": 0}]},
        {"whole": [{"name": "a\0b", "size": 6, "crc32": 0}]},
        {"whole": 3},
        {"lines": None},
        {"facts": "text"},
        {"exit_code": float("inf")},
    ],
)
def test_not_by_a_file_that_is_something_else(folder: Path, changed: Any):
    file = folder / FINISHED_FILE
    kept = json.loads(file.read_bytes())
    torn = changed if isinstance(changed, bytes) else json.dumps({**kept, **changed}).encode()
    file.write_bytes(torn)
    assert told(folder) is None


def test_what_is_told_has_no_power_over_the_terminal(folder: Path):
    file = folder / FINISHED_FILE
    kept = json.loads(file.read_bytes())
    file.write_text(json.dumps({**kept, "lines": ["\x1b[2Jall well\nreally"]}))
    assert told(folder).lines == (r"\x1b[2Jall well\nreally",)


def test_it_is_whole_or_as_before(folder: Path, monkeypatch: pytest.MonkeyPatch):
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    report = MapReport(DONE, folder, Walked(()), None, None)
    before = (folder / FINISHED_FILE).read_bytes()
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="No space"):
        Finished(run_in(folder), ASKED).keep(report)
    assert (folder / FINISHED_FILE).read_bytes() == before
