"""Threads whose frame was given up: they cannot be ended, and end with the process."""

from __future__ import annotations

import threading

WORKER_NAME = "frame-worker"


def still_working() -> bool:
    """Whether a frame that nobody waits for any more is still being worked on."""
    return any(each.name.startswith(WORKER_NAME) for each in threading.enumerate())
