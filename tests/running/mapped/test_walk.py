"""What is remembered of each frame, and what may rest on its pose."""

from __future__ import annotations

import base64
import csv
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED
from pseudolidar.mapping.extrapolating import ExtrapolatingChain
from pseudolidar.mapping.scan_counts import ScanCounts
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.mapped.frame_table import write_frame_table
from pseudolidar.running.mapped.glimpse import Glimpse
from pseudolidar.running.mapped.walk import Walk
from pseudolidar.running.reports.map_plots import path_plots
from pseudolidar.running.reports.map_report import MapReport, errors_of
from pseudolidar.structures.box import Detection
from pseudolidar.structures.pose import Pose
from tests.mapping.told_chain import UNKNOWN, ToldChain, frames_for, going

AHEAD = [0.0, 0.0, 8.0, 0.0, 0.0, 0.0]


class Asked:
    """A search for loops that records which frames it was asked of."""

    refused: Any = {}  # noqa: RUF012
    whole = True

    def __init__(self):
        self.wanted, self.added = [], []

    def wants(self, T: Any, _piece: int) -> bool:
        self.wanted.append(T)
        return True

    def add(self, index: int, *_seen: Any, **_more: Any) -> list[Any]:
        self.added.append(index)
        return []


def walked(statuses: str, *, reach=5, loops=None, truth=None):
    states = going(AHEAD, statuses)
    frames = frames_for(states)
    walk = Walk(ExtrapolatingChain(ToldChain(states), reach=reach), frames[0].rig, loops)
    for i, frame in enumerate(frames):
        walk.step(frame if truth is None else truth(i, frame), UNKNOWN, ())
    return walk


def test_no_loop_rests_on_what_nobody_measured():
    loops = Asked()
    walked("fooxxoo", loops=loops)
    assert loops.added == [0, 1, 2, 5, 6]
    assert len(loops.wanted) == 5


def test_nor_is_it_shown_to_who_looks_on():
    states = going(AHEAD, "foox")
    chain, frames = ExtrapolatingChain(ToldChain(states), reach=5), frames_for(states)
    seen = []
    for frame in frames:
        state = chain.register(frame, UNKNOWN).state
        seen.append(Glimpse.of(frame, UNKNOWN, state).T_odom_camera)
    assert state.T_odom_camera is not None
    assert [one is None for one in seen] == [False, False, False, True]


def test_a_pose_that_no_later_frame_bears_out_is_withdrawn():
    path = walked("fooxxxf", reach=2).walked()
    statuses = ["first", "ok", "ok", "lost", "lost", "lost", "first"]
    assert [one.status for one in path.placed] == statuses
    assert ["withdrawn" in one.why for one in path.placed[3:6]] == [True, True, False]
    assert path.placed[3].why.startswith("it is dark; ")
    assert [len(piece.frames) for piece in path.pieces] == [3, 1]


def test_of_masks_the_boxes_are_kept():
    states = going(AHEAD, "f")
    (frame,) = frames_for(states)
    walk = Walk(ExtrapolatingChain(ToldChain(states), reach=5), frame.rig)
    walk.step(frame, UNKNOWN, [Detection("car", (0, 0, 9, 9), mask=np.ones((32, 64), np.bool_))])
    (one,) = walk.placed[0].movable
    assert (one.name, one.mask) == ("car", None)


def test_a_path_that_ends_is_told_by_the_exit_status():
    result: Any = SimpleNamespace(exit_code=ALL_DONE)
    codes = []
    for statuses in ("foo", "fooxo", "foof"):  # vision begins anew, no frame is lost
        path = walked(statuses).walked()
        assert not any(one.lost for one in path.placed)
        codes.append(MapReport(result, None, path, None, None).exit_code)
    assert codes == [ALL_DONE, ALL_DONE, SOME_SKIPPED]


def test_from_above_is_from_above_where_the_way_climbs():
    def truth(i: int, frame: Any) -> Any:
        T = np.eye(4)
        T[:3, 3] = (0.8 * i, 0.01 * i, 0.2 * i)  # farther up than sideways
        return replace(frame, pose=Pose("map", "base_link", T))

    path = walked("fooooo", truth=truth).walked()
    report = MapReport(SimpleNamespace(), None, path, errors_of(path.pieces), None)
    ((above, _),) = (row.pictures for row in path_plots(report))
    drawn = base64.b64decode(above.uri.partition(",")[2]).decode()
    assert "<!-- x, m -->" in drawn
    assert "<!-- y, m -->" in drawn


def test_odd_scans_are_told_in_a_line():
    result: Any = SimpleNamespace(exit_code=ALL_DONE, ended_early=False, text=lambda: "done")

    def text(scans: ScanCounts | None) -> str:
        path = replace(walked("foo").walked(), scans=scans)
        return MapReport(result, None, path, None, None).text()

    assert "scan" not in text(None) + text(ScanCounts(3, deskewed=3))
    told = text(ScanCounts(9, empty=1, unplaced=2, dropped_points=1))
    assert "  3 of 9 scans left out: 1 without a usable point, 2 that lie nowhere" in told
    assert "; 1 point of scans dropped" in told
    assert "\n  1,234 points of scans dropped" in text(ScanCounts(3, dropped_points=1234))


def test_errors_are_of_what_was_measured():
    def truth(i: int, frame: Any) -> Any:
        T = np.eye(4)
        T[0, 3] = 0.8 * i + 5.0 * (i == 3)  # nobody measured where the fourth frame is
        return replace(frame, pose=Pose("map", "base_link", T))

    path = walked("fooxoo", truth=truth).walked()
    assert [one.extrapolated for one in path.placed] == [i == 3 for i in range(6)]
    errors = errors_of(path.pieces)
    assert errors is not None
    assert len(errors.pairs) == 5
    assert errors.ape_m.max() < 1e-6


def test_each_frame_has_its_line_of_the_table(tmp_path):
    path = walked("fooxo").walked()
    skipped = [FrameRecord("bad", 2, skipped={"code": "ImageUnreadable", "got": "no picture"})]
    ids = ["000000", "000001", "bad", *(f"{i:06d}" for i in range(2, 5))]
    rows = list(csv.DictReader(write_frame_table(tmp_path, path, ids, skipped).open()))
    assert [row["frame"] for row in rows] == ids
    assert [row["status"] for row in rows] == [
        *("first", "ok", "skipped", "ok", "extrapolated", "ok"),
    ]
    assert [row["row"] for row in rows] == ["1", "2", "", "3", "4", "5"]
    assert rows[2]["why"] == "ImageUnreadable: no picture"
