"""Per-frame work that crashes, hangs and eats memory, for real; importable by worker processes."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.running.conftest import TextureSource

MB = 1_000_000


def read_null() -> None:
    ctypes.string_at(0)


def abort() -> None:
    ctypes.CDLL(None).abort()


def hang() -> None:
    """In C, with the interpreter's lock held: no thread of the process can do anything."""
    ctypes.PyDLL(None).sleep(600)


def hog() -> None:
    """Two gigabytes in small, touched pieces."""
    kept = [np.ones(MB) for _ in range(250)]
    assert kept


def want_everything() -> None:
    np.empty(1 << 48, np.uint8)


def unpack_much() -> None:
    import cv2

    cv2.resize(np.zeros((10, 10), np.uint8), (20_000, 60_000))


def leave() -> None:
    os._exit(7)


def be_killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


FAULTS = {f.__name__: f for f in (
    read_null, abort, hang, hog, want_everything, unpack_much, leave, be_killed,
)}  # fmt: skip


@dataclass(frozen=True)
class Misbehave:
    """Sums a frame's pixels; some frames do worse.

    Args:
        at: name of a fault by frame index.
        once: folder of marks: a frame that left one there behaves the second time.
        pause_s: how long each frame takes at least.
    """

    at: dict[int, str] = field(default_factory=dict)
    once: Path | None = None
    pause_s: float = 0.0

    def __call__(self, frame: Any) -> tuple[int, bytes]:
        time.sleep(self.pause_s)
        fault = self.at.get(frame.index)
        mark = self.once / frame.id if self.once else None
        if fault and not (mark and mark.exists()):
            if mark:
                mark.touch()
            FAULTS[fault]()
        return int(frame.left.sum()), np.repeat(frame.left, 100).tobytes()


@dataclass(frozen=True)
class CrashingSource:
    """Its frame 1 crashes the reader."""

    inner: TextureSource = TextureSource(3)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "inner":
            raise AttributeError(name)
        return getattr(self.inner, name)

    def load(self, index: int) -> Any:
        if index == 1:
            read_null()
        return self.inner.load(index)
