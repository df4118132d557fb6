"""Pairs of cameras as a source: workers wait for the next one, and hold up nobody meanwhile."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from pseudolidar.sources.bare_pairs import BarePair
from pseudolidar.sources.capture.cameras import Cameras, CameraSettings
from pseudolidar.sources.capture.eyes import Bare, Eyes
from pseudolidar.sources.capture.live_pairs import LivePairs
from pseudolidar.sources.source import SourceSummary
from tests.cameras import eyes, write_eyes

PATIENCE_S = 20.0


def test_a_finished_frame_does_not_wait_for_the_pair_that_another_worker_waits_for(
    tmp_path: Path,
) -> None:
    """Else each frame is written when its successors are there: late by an interval a worker."""
    left, right = write_eyes(tmp_path, *eyes(3))
    waits, told = threading.Event(), threading.Event()
    asked: list[int] = []

    def wanted(shots) -> bool:
        asked.append(shots.time_ns)
        if len(asked) == 2:
            waits.set()
            told.wait(PATIENCE_S)
        return True

    cameras = Cameras(str(left), str(right), True, CameraSettings(speed=20.0, kept=3))
    with cameras.open() as capture:
        source = LivePairs(
            capture,
            Bare(Eyes()),
            yields=BarePair,
            summary=SourceSummary("cameras", str(left), "cameras"),
            rig=None,
            wanted=wanted,
        )
        capture.begin()
        source.load(0)
        next_one = threading.Thread(target=source.load, args=(1,), daemon=True)
        next_one.start()
        assert waits.wait(PATIENCE_S)
        found: list[int] = []
        asking = threading.Thread(target=lambda: found.append(source.taken_ns(0)), daemon=True)
        asking.start()
        asking.join(PATIENCE_S / 4)
        try:
            assert len(found) == 1
        finally:
            told.set()
            next_one.join(PATIENCE_S)


@pytest.mark.parametrize(("late_ms", "together"), [(0, True), (4, True), (30, False)])
def test_what_is_looked_at_before_the_start_is_told_to_be_of_one_moment_or_not(
    tmp_path: Path, late_ms: int, together: bool
) -> None:
    """Videos are held at their first pictures: there is no pair to wait for yet."""
    ticks = [late_ms + 20 * number for number in range(3)]
    left, right = write_eyes(tmp_path, *eyes(3), right_ticks=ticks)
    with Cameras(str(left), str(right), True).open() as capture:
        source = LivePairs(
            capture,
            Bare(Eyes()),
            yields=BarePair,
            summary=SourceSummary("cameras", str(left), "cameras"),
            rig=None,
        )
        frame, of_one_moment = source.specimen(within_s=0.1)
    assert isinstance(frame, BarePair)
    assert of_one_moment is together
