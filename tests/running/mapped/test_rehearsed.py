"""What all frames of a map are thought to take, by those that were tried."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pseudolidar.errors import LowTexture, OutputError
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.mapped.rehearsed import NONE_PASSED, MapRehearsal, Trial, rehearse_map
from pseudolidar.running.mapped.stored import MatchedFrame
from pseudolidar.running.products.product import Product
from pseudolidar.sources.synthetic import Synthetic

TRIAL = Trial(6, 0.08, 0.06, 0.1, work_bytes=1e6, map_bytes=(12_000_000, 5e5))


def told(tmp_path: Path, trial: Trial = TRIAL, *, workers: int = 2) -> MapRehearsal:
    return MapRehearsal.of(
        trial, frames=106, workers=workers, folder=tmp_path, besides=("closing loops",)
    )


def test_each_further_frame_adds_what_the_last_ones_added(tmp_path: Path):
    one = told(tmp_path)
    assert one.map_bytes == 12_000_000 + 100 * 500_000
    assert one.work_bytes == 106_000_000
    assert one.whole.bytes == one.map_bytes + one.work_bytes


def test_odometry_goes_on_beside_matching(tmp_path: Path):
    """Two workers share the cores with it; many wait for it."""
    assert told(tmp_path).whole.seconds == pytest.approx(106 * (0.04 + 0.03 + 0.1))
    assert told(tmp_path, workers=16).whole.seconds == pytest.approx(106 * (0.06 + 0.1))


def test_each_part_and_what_is_not_known_has_a_line(tmp_path: Path):
    lines = told(tmp_path).text().splitlines()
    assert lines[0].startswith("dry run: 106 frames, about 168 MB and 18 s")
    assert [line.split(":")[0].strip() for line in lines[1:]] == [
        "matching",
        "odometry",
        "the map along the path",
        "not estimated",
    ]


def test_of_a_path_alone_no_map_is_told(tmp_path: Path):
    alone = told(tmp_path, Trial(6, 0.08, 0.06, 0.001, work_bytes=1e6, map_bytes=(0, 0.0)))
    assert "along the path" not in alone.text()
    assert alone.as_dict()["map_bytes"] == 0


def test_where_nothing_could_be_placed_nothing_is_made_up(tmp_path: Path):
    one = told(tmp_path, Trial(6, 0.08, 0.06, None, work_bytes=1e6, map_bytes=(0, 0.0)))
    assert one.as_dict()["map_bytes"] is None
    assert one.as_dict()["map_s"] is None
    assert "the map: no frame that was tried could be placed" in one.not_estimated
    assert "along the path" not in one.text()


def test_what_will_not_fit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pseudolidar.running.mapped.rehearsed.free_bytes", lambda _: 150_000_000)
    with pytest.raises(OutputError, match="150000000 are free"):
        told(tmp_path).checked()


class Stands:
    """A walk of which every frame is on one piece of path."""

    def __init__(self) -> None:
        self.frames: list[Any] = []

    def step(self, frame: Any, *_seen: Any) -> None:
        self.frames.append(frame)

    def walked(self) -> Any:
        frames = tuple(self.frames)
        return SimpleNamespace(pieces=(SimpleNamespace(frames=frames),) if frames else ())


@pytest.mark.parametrize("bad", [(), (8,), (7, 8), range(12)])
def test_frames_in_the_midst_are_tried_and_bad_ones_tell_nothing(tmp_path: Path, bad):
    """Six of twelve; each is a kilobyte of the map."""
    source = Synthetic("street", frames=12, width_px=64, height_px=32).open()
    asked = []

    def match(frame: Any) -> Any:
        asked.append(frame.index)
        if frame.index in bad:
            raise LowTexture("nothing", want="something")
        product = Product((OutputFile.of(f".work/{frame.id}.disparity", bytes(10)),))
        return MatchedFrame(frame, None, (), product)

    def make(folder: Path, pieces: Any) -> None:
        for frame in pieces[0].frames if pieces else ():
            (folder / frame.id).write_bytes(bytes(1000))

    walk: Any = Stands()
    arguments = {"folder": tmp_path, "crew": CrewPlan(1), "besides": ()}
    one = rehearse_map(source, match, walk, make, **arguments)
    assert asked == [3, 4, 5, 6, 7, 8]
    passed = 6 - len(set(asked) & set(bad))
    assert one.work_bytes == (120 if passed else 0)
    assert one.map_bytes == (12_000 if passed else None)
    assert (NONE_PASSED in one.not_estimated) is (not passed)
    assert not list(tmp_path.iterdir())
