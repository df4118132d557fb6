"""Made paths with errors that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.formats.trajectory_file import PoseRecord
from pseudolidar.geometry.twists import exp_twist, exp_twists

STEP_NS = 100_000_000
START_NS = 1_400_000_000_000_000_000


def winding(poses: int, *, step_m: float = 1.0) -> np.ndarray:
    """(N, 4, 4) a path that winds and climbs, so many metres a pose."""
    twists = np.zeros((poses - 1, 6))
    turns = np.sin(np.arange(poses - 1) / 23.0)
    twists[:, 0], twists[:, 2], twists[:, 5] = step_m, 0.05 * step_m, 0.05 * turns
    return chained(exp_twists(twists))


def drifting(T_world_body: np.ndarray, *, seed: int = 0, noise: float = 0.01) -> np.ndarray:
    """The same path from motions that are each a little off, in another world."""
    steps = np.linalg.inv(T_world_body[:-1]) @ T_world_body[1:]
    off = np.random.default_rng(seed).normal(0, noise, (len(steps), 6)) * (1, 1, 1, 0.1, 0.1, 0.1)
    elsewhere = exp_twist(np.array([30.0, -4.0, 2.0, 0.1, 0.2, 2.0]))
    return elsewhere @ chained(steps @ exp_twists(off))


def chained(steps: np.ndarray) -> np.ndarray:
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.array(poses)


def record(T: np.ndarray, times_ns: np.ndarray | None = None, name: str = "a.txt") -> PoseRecord:
    form = "KITTI" if times_ns is None else "TUM"
    return PoseRecord(Path(name), form, T, times_ns)


def stamps(n: int, *, begin_ns: int = START_NS) -> np.ndarray:
    return begin_ns + STEP_NS * np.arange(n, dtype=np.int64)
