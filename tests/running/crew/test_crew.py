"""Workers at the end of a process, and frames that do not end."""

import subprocess
import sys
import threading
import time

import pytest

from pseudolidar.errors import FrameTimeout, UsageError
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.stream import stream

CHILD = """
import cv2
import numpy as np
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew import Crew

image = np.zeros((1500, 1500, 3), np.uint8)
cv2.setNumThreads(1)

class Blurring:
    def prepare(self): pass
    def drop(self): pass
    def end(self): pass
    def do(self, index):
        for _ in range(30):  # comes back from C++ again and again
            cv2.medianBlur(image, 5)
        return Done(str(index), index, None)

def begin():
    with Crew(Blurring, 2, timeout_s=60) as crew:
        tasks = [crew.submit(index) for index in range(6)]
        crew.outcome(tasks[0], "0")
        yield

left_open = begin()
next(left_open)
raise SystemExit(3)
"""


def test_a_process_may_end_while_frames_are_worked_on():
    """Threads that met the interpreter's end inside OpenCV would abort it (exit code -6)."""
    ended = subprocess.run(
        [sys.executable, "-c", CHILD], capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stderr) == (3, "")


@pytest.mark.parametrize("workers", [1, 2])
def test_frames_that_hang_are_given_up_and_the_others_done(texture_source, workers):
    """More of them hang than there are workers: each gets a successor."""
    release = threading.Event()

    def hangs(frame):
        if frame.index in (1, 2, 5):
            release.wait(60)
        return frame.index

    begin_s = time.monotonic()
    outcomes = list(stream(texture_source(8), hangs, crew=CrewPlan(workers, timeout_s=0.3)))
    took_s = time.monotonic() - begin_s
    release.set()
    assert [o.id for o in outcomes if isinstance(o, Done)] == [f"00000{i}" for i in (0, 3, 4, 6, 7)]
    late = [o for o in outcomes if not isinstance(o, Done)]
    assert [o.index for o in late] == [1, 2, 5]
    assert all(isinstance(o.error, FrameTimeout) for o in late)
    assert "within 0.3 s" in str(late[0].error)
    assert "frame 000001" in str(late[0].error)
    assert took_s < 30  # of 60 that they would hang


def test_a_queue_is_no_delay(texture_source):
    """The time of a frame counts from its beginning, not from when it was queued."""

    def slow(frame):
        time.sleep(0.25)

    outcomes = list(stream(texture_source(6), slow, crew=CrewPlan(1, timeout_s=0.5)))
    assert all(isinstance(outcome, Done) for outcome in outcomes)


@pytest.mark.parametrize(
    ("options", "flag"),
    [
        ({"workers": 0}, "--workers"),
        ({"timeout_s": 0.0}, "--timeout"),
        ({"timeout_s": float("nan")}, "--timeout"),
        ({"memory_limit_mb": 100.0}, "--memory-limit"),
        ({"memory_limit_mb": -1.0, "isolate": True}, "--memory-limit"),
    ],
)
def test_a_crew_that_cannot_be_is_refused(options, flag):
    with pytest.raises(UsageError, match=flag):
        CrewPlan(**options)
