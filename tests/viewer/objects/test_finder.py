"""Objects found in the background."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import Frame, RecordedCloud
from pseudolidar.viewer.objects.finder import REMEMBERED, Finder
from pseudolidar.viewer.objects.objects import Objects

FRAMES = [
    RecordedCloud(PointCloud(np.zeros((1, 3), np.float32), "velodyne"), str(i), i, i)
    for i in range(REMEMBERED + 3)
]


class Trial:
    """A way of finding that waits until it is let go."""

    def __init__(self) -> None:
        self.begun, self.go = threading.Semaphore(0), threading.Semaphore(0)
        self.asked: list[int] = []

    def __call__(self, frame: Frame) -> Objects:
        self.asked.append(frame.index)
        self.begun.release()
        self.go.acquire(timeout=60)
        return Objects(fault=frame.id)


@pytest.fixture
def came() -> list[int]:
    return []


@pytest.fixture
def finder(came: list[int]) -> Iterator[Finder]:
    arrived = threading.Semaphore(0)

    def tell(index: int) -> None:
        came.append(index)
        arrived.release()

    made = Finder(tell)
    made.arrived = arrived  # type: ignore[attr-defined]
    yield made
    made.close()


def wanted(*indices: int) -> list[tuple[int, Frame]]:
    return [(index, FRAMES[index]) for index in indices]


def arrive(finder: Finder) -> None:
    assert finder.arrived.acquire(timeout=60)  # type: ignore[attr-defined]


def test_only_the_latest_wish_is_looked_for(finder: Finder, came: list[int]):
    trial = Trial()
    finder.change(trial)
    finder.want(wanted(0, 1, 2))
    assert trial.begun.acquire(timeout=60)
    finder.want(wanted(7))
    trial.go.release(10)
    arrive(finder)
    arrive(finder)
    assert trial.asked == came == [0, 7]
    assert [finder.get(index) is None for index in (0, 1, 7)] == [False, True, False]


def test_what_was_begun_in_another_way_is_not_taken(finder: Finder, came: list[int]):
    old, new = Trial(), Trial()
    finder.change(old)
    finder.want(wanted(0))
    assert old.begun.acquire(timeout=60)
    finder.change(new)
    old.go.release()
    finder.want(wanted(1))
    new.go.release()
    arrive(finder)
    assert came == [1]
    assert finder.get(0) is None
    finder.change(None)
    assert finder.get(1) is None


def test_a_frame_that_breaks_a_detector_is_told_and_the_next_one_is_found(
    finder: Finder, caplog: pytest.LogCaptureFixture
):
    def odd(frame: Frame) -> Objects:
        if frame.index == 0:
            raise ZeroDivisionError("odd")
        return Objects()

    finder.change(odd)
    finder.want(wanted(0, 1))
    arrive(finder)
    arrive(finder)
    objects = finder.get(0)
    assert objects is not None
    assert objects.fault == "ZeroDivisionError: odd"
    assert finder.get(1) is not None


def test_memory_has_an_end(finder: Finder):
    finder.change(lambda frame: Objects(fault=frame.id))
    for index in range(len(FRAMES)):
        finder.want(wanted(index))
        arrive(finder)
    held = [index for index in range(len(FRAMES)) if finder.get(index) is not None]
    assert held == list(range(3, len(FRAMES)))
