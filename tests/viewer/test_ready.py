"""Frames made ready in the background."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.ready import Ready

BYTES = 12_000


def moment(index: int) -> Moment:
    cloud = PointCloud(np.zeros((BYTES // 12, 3), np.float32), "velodyne")
    return Moment(str(index), index, clouds={"points": cloud})


def wait_until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end, "not in time"
        time.sleep(0.002)


def test_what_is_wanted_becomes_ready_in_that_order():
    made: list[int] = []

    def load(index: int) -> Moment:
        made.append(index)
        return moment(index)

    ready = Ready(load, workers=1)
    assert ready.get(3) is None
    ready.want([3, 4, 5])
    wait_until(lambda: ready.get(5) is not None)
    assert made == [3, 4, 5]
    ready.want([3, 4, 5])
    ready.close()
    assert made == [3, 4, 5]


def test_the_memory_is_bounded_and_the_shown_frame_is_kept():
    ready = Ready(moment, workers=2, budget_bytes=5 * BYTES)
    for index in range(60):
        ready.want(range(index, index + 4))
        wait_until(lambda index=index: ready.get(index) is not None)  # type: ignore[misc]
        assert ready.nbytes <= 6 * BYTES
    ready.close()


def test_a_frame_larger_than_all_memory_is_shown_all_the_same():
    ready = Ready(moment, workers=1, budget_bytes=10)
    ready.want([0, 1, 2])
    wait_until(lambda: ready.get(0) is not None)
    ready.close()
    assert ready.nbytes == BYTES


def test_what_is_wanted_no_more_is_not_made():
    gate, made = threading.Event(), list[int]()

    def load(index: int) -> Moment:
        made.append(index)
        gate.wait(60)
        return moment(index)

    ready = Ready(load, workers=1)
    ready.want(range(10))
    wait_until(lambda: made == [0])
    ready.want([50])
    gate.set()
    wait_until(lambda: ready.get(50) is not None)
    ready.close()
    assert made == [0, 50]


def test_frames_of_old_settings_are_not_taken_in():
    gate, begun = threading.Event(), threading.Event()
    names = iter(("old", "new"))

    def load(index: int) -> Moment:
        name = next(names)
        begun.set()
        if name == "old":
            gate.wait(60)
        return Moment(name, index)

    ready = Ready(load, workers=2)
    ready.want([0])
    assert begun.wait(60)
    ready.forget()
    ready.want([0])
    wait_until(lambda: ready.get(0) is not None)
    gate.set()
    ready.close()
    shown = ready.get(0)
    assert shown is not None
    assert shown.id == "new"


def test_a_frame_that_is_odd_in_a_new_way_is_not_waited_for(caplog: pytest.LogCaptureFixture):
    def load(index: int) -> Moment:
        raise ValueError("odd")

    ready = Ready(load, workers=1)
    ready.want([3])
    wait_until(lambda: ready.get(3) is not None)
    ready.close()
    shown = ready.get(3)
    assert shown is not None
    assert (shown.index, shown.fault) == (3, "it cannot be shown: see the terminal")
    assert "frame 3 cannot be made" in caplog.text
