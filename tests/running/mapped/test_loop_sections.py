"""Loops in the report of a map."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from pseudolidar.mapping.registered import Registered
from pseudolidar.running.mapped.walked import Placed, Walked
from pseudolidar.running.reports.loop_sections import loop_sections
from pseudolidar.running.reports.map_report import loop_dict
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.loop import LoopClosure, LoopEnd
from pseudolidar.structures.odometry import OdometryState
from tests.mapping.told_chain import frames_for


def closure(correction_m: float) -> LoopClosure:
    uv = np.array([[20.0, 30.0], [50.0, 40.0], [90.0, 20.0]], np.float32)
    return LoopClosure(
        LoopEnd(1, 1_100_000_000),
        LoopEnd(3, 1_300_000_000),
        np.eye(4),
        np.eye(6),
        uv,
        uv + 2,
        np.array([0.25, 0.5, 0.75]),
        matches=6,
        overlap=0.75,
        both_ways_m=0.01,
        both_ways_deg=0.1,
        correction_m=correction_m,
        correction_deg=2.0,
    )


def test_each_loop_has_its_numbers_and_two_pictures():
    every = Synthetic("room", frames=4, width_px=128).open()
    source = select(every, FrameSelection.parse("1:4"), None)  # places are not indices here
    placed = tuple(
        Placed.of(frame, Registered(OdometryState("lost")), None, ())
        for frame in frames_for(range(4))
    )
    walked = Walked((), placed, (closure(1.5),), (closure(9.0),), {"few_matches": 4})
    (section,) = loop_sections(walked, source)
    assert (
        section.text == "1 loop closed, 1 dropped by the rest; candidates refused: 4 few matches."
    )
    assert section.table[0] == (
        *("000001 - 000003", "3", "6", "0.50", "75.00 %", "0.010", "0.10", "1.50", "2.00"),
    )
    assert section.table[1][0] == "000001 - 000003 (dropped)"
    pictures = [picture for row in section.pictures for picture in row.pictures]
    assert [p.caption.split(":")[0] for p in pictures] == ["000001", "000003"] * 2
    data = base64.b64decode(pictures[0].uri.partition(",")[2])
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape == every.load(1).left.shape
    assert loop_dict(closure(1.5))["residual_px"] == 0.5


def test_a_path_without_returns_says_nothing():
    assert loop_sections(Walked(()), Synthetic("room", frames=1, width_px=64).open()) == []
