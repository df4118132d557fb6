"""Poses of frames of which nothing is measured: how far they are off, and whether they know it.

    python -m tests.benchmarks.extrapolated

Exact paths (street, block, room, flight; KITTI 06 and the first 1500 frames of 00) with the noise
of odometry, 3 mm and 0.1 mrad a step at 10 frames a second. At every seventh frame a path of some
seconds begins, with noise of its own; at its end it goes on for 1, 3 and 5 frames, as
`ExtrapolatingChain` does it, or so many frames in it are bridged, as `bridged` does it. NEES is the
normalised squared error of a pose in `odom` by its six dimensions: 1 is exact, less is careful.
Metres are since the last pose that was measured. Accelerations are those of the whole path, one
standard deviation by axis, m/s2 and rad/s2, thought ones included.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from pseudolidar.formats.trajectory import read_kitti_poses
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import carried, exp_twist, gone_on, inverted, log_twist
from pseudolidar.mapping.bridges import bridged, steadiness_of
from pseudolidar.mapping.path import stacked
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import Trajectory
from tests.conftest import DATA

STEP_S, NOISE = 0.1, np.repeat([0.003, 0.0001], 3)
WORLDS = {"street": 200, "block": 400, "room": 120, "flight": 120}
FILES = {
    "KITTI 06": DATA / "kitti_odometry" / "poses" / "06.txt",
    "KITTI 00": DATA / "trajectories" / "KITTI_00_gt.txt",
}
GAPS, LONGEST = (1, 3, 5), 1500
# Where paths begin, and how many frames they have before a gap and after it.
EVERY, BEFORE, AFTER = 7, 30, 5


@dataclass(eq=False)
class Off:
    """How far poses of one kind are off."""

    nees: list[float] = field(default_factory=list)
    metres: list[float] = field(default_factory=list)

    def add(self, T: Float64, exact: Float64, doubt: Float64, since: int, path: Trajectory) -> None:
        """One of them, with the exact poses (N, 4, 4), the last of which it should be."""
        error = log_twist(inverted(T) @ exact[-1])
        self.nees.append(float(error @ np.linalg.solve(doubt, error)) / 6)
        own = inverted(path.T_world_body[since]) @ T
        true = inverted(exact[since]) @ exact[-1]
        self.metres.append(float(np.linalg.norm((inverted(own) @ true)[:3, 3])))

    def __str__(self) -> str:
        high = np.quantile(self.nees, 0.95)
        return (
            f"NEES {np.mean(self.nees):5.2f} (95 % below {high:5.2f}), "
            f"off {np.mean(self.metres):.3f} m, at most {max(self.metres):.2f}"
        )


def paths() -> Iterator[tuple[str, Float64]]:
    """Names and poses (N, 4, 4) of left cameras, exact."""
    for name, frames in WORLDS.items():
        source = Synthetic(name, frames=frames).open()
        yield name, source.trajectory.T_world_body @ left_in_base_link(source.rig).matrix
    for name, file in FILES.items():
        if file.exists():
            yield name, read_kitti_poses(file)[:LONGEST]


def measured(exact: Float64, rng: np.random.Generator) -> Trajectory:
    """A path as odometry would have it."""
    step_doubt = np.diag(NOISE**2)
    poses, doubts = [exact[0]], [np.zeros((6, 6))]
    for before, after in itertools.pairwise(exact):
        step = inverted(before) @ after @ exp_twist(NOISE * rng.normal(size=6))
        poses.append(poses[-1] @ step)
        doubts.append(carried(doubts[-1], step) + step_doubt)
    times_ns = np.arange(len(exact), dtype=np.int64) * round(STEP_S * 1e9)
    return stacked(times_ns.tolist(), poses, doubts)


def extrapolated(exact: Float64, gap: int) -> Off:
    """Poses `gap` frames after the last that was measured, as the last step went."""
    off, rng = Off(), np.random.default_rng(0)
    for begin in range(0, len(exact) - BEFORE - gap, EVERY):
        true = exact[begin : begin + BEFORE + gap]
        path = measured(true[:BEFORE], rng)
        last, now = path.T_world_body[-2:]
        twist, seconds = log_twist(inverted(last) @ now) / STEP_S, gap * STEP_S
        doubt = steadiness_of(path).gone_on(
            path.doubts[-1], np.diag(NOISE**2), twist, STEP_S, seconds
        )
        off.add(gone_on(now, twist, seconds), true, doubt.total, BEFORE - 1, path)
    return off


def between(exact: Float64, gap: int) -> Off:
    """Poses in the midst of gaps of so many frames."""
    off, rng = Off(), np.random.default_rng(1)
    for begin in range(0, len(exact) - BEFORE - gap - AFTER, EVERY):
        true = exact[begin : begin + BEFORE + gap + AFTER]
        path, middle = measured(true, rng), BEFORE + gap // 2
        kept = np.r_[0:BEFORE, BEFORE + gap : len(true)]
        some = stacked(
            path.timestamps_ns[kept].tolist(), path.T_world_body[kept], path.doubts[kept]
        )
        whole = bridged(some, path.timestamps_ns[middle : middle + 1])
        (at,) = np.flatnonzero(whole.extrapolated)
        T, doubt = whole.T_world_body[at], whole.doubts[at]
        off.add(T, true[: middle + 1], doubt, BEFORE - 1, path)
    return off


def main() -> None:
    """Print the table."""
    for name, exact in paths():
        for gap in GAPS:
            say(f"{name:9s} {gap} on:      {extrapolated(exact, gap)}")
        for gap in GAPS:
            say(f"{name:9s} {gap} bridged: {between(exact, gap)}")
        sigmas = np.sqrt(steadiness_of(measured(exact, np.random.default_rng(2))).variance)
        say(f"{name:9s} accelerations {' '.join(f'{one:.2f}' for one in sigmas)}")


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
