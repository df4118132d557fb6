"""A thread that is asked for by many and ended by one."""

from __future__ import annotations

import threading

from pseudolidar.viewer.late_thread import LateThread


def test_it_can_be_ended_while_it_begins(slow_starts: threading.Event):
    ended = threading.Event()
    late = LateThread(ended.wait, "late")
    asking = threading.Thread(target=late.begin)
    asking.start()
    assert slow_starts.wait(60)
    ended.set()
    late.close()
    asking.join()
    assert not [thread for thread in threading.enumerate() if thread.name == "late"]


def test_it_begins_once_whoever_asks(slow_starts: threading.Event):
    runs: list[None] = []
    late = LateThread(lambda: runs.append(None), "late")
    asking = [threading.Thread(target=late.begin) for _ in range(4)]
    for thread in asking:
        thread.start()
    for thread in asking:
        thread.join()
    late.close()
    assert slow_starts.is_set()
    assert len(runs) == 1


def test_it_does_not_begin_after_its_end():
    runs: list[None] = []
    late = LateThread(lambda: runs.append(None), "late")
    late.close()
    late.begin()
    late.close()
    assert not runs
