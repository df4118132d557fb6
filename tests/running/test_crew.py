"""Workers at the end of a process."""

import subprocess
import sys

CHILD = """
import cv2
import numpy as np
from pseudolidar.running.crew import Crew

image = np.zeros((1500, 1500, 3), np.uint8)
cv2.setNumThreads(1)

def work():
    for _ in range(30):  # comes back from C++ again and again
        cv2.medianBlur(image, 5)

def begin():
    with Crew(2) as crew:
        futures = [crew.submit(work) for _ in range(6)]
        futures[0].result()
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
