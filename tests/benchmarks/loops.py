"""Loops on a block driven round twice, and on ten different streets, where there are none.

    python -m tests.benchmarks.loops [DATA]

Rendered keyframes every 3.2 m (block, two rounds of 256 m) and 4 m (streets with seeds 0 to 9, 100
m each, all remembered by one finder as pieces of their own), 640 px wide, disparities by Census.
Odometry is exact but for drift that is put in: each step is turned by 0.05 degrees and noise. With
DATA, KITTI 06: every sixth frame, and then those between, darker and with noise, as a piece of its
own. Times are CPU times, in turns with matching the same frames. A false loop, and a drift of 2 m
that is not closed to 0.2 m, are named, and end it with 1.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.loops import LoopFinder, LoopSearch
from pseudolidar.mapping.pose_graph import closed
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.source import FrameSequence
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean, Cleaner
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.loop import LoopClosure
from pseudolidar.structures.pose import Trajectory
from tests.benchmarks.judging import Figure, end

WIDTH_PX, DAY_NS = 640, 86_400 * 10**9
ROUND, EVERY = 320, 4
DRIFT = np.concatenate([np.zeros(3), np.deg2rad([0.01, 0.05, 0.01])])
DRIFT_SIGMA = np.repeat([0.004, 0.0004], 3)
# What is wanted: a drift of so much at least, m, is closed to so much at most. A loop that is
# farther off is false.
DRIFT_M, CLOSED_M = 2.0, 0.2


@dataclass
class Finding:
    """A finder with what it told and took."""

    search: LoopSearch
    loops: list[LoopClosure] = field(default_factory=list)
    match_ms: list[float] = field(default_factory=list)
    loop_ms: list[float] = field(default_factory=list)
    match: object = field(default_factory=lambda: Census().load())
    clean: object = field(default_factory=lambda: Cleaner.load(Clean()))

    def add(self, frame: StereoFrame, T_odom: np.ndarray, piece: int = 0) -> None:
        """Match the frame and look whether its place is known."""
        began = time.process_time()
        disparity = self.clean(frame, self.match(frame)).disparity
        matched = time.process_time()
        self.loops += self.search.add(frame.index, frame, disparity, T_odom, piece=piece)
        self.match_ms.append(1e3 * (matched - began))
        self.loop_ms.append(1e3 * (time.process_time() - matched))

    def line(self) -> str:
        """What it took."""
        share = np.median(self.loop_ms) / np.median(self.match_ms)
        return (
            f"{self.search.places} keyframes, {self.search.bytes / self.search.places:.0f} bytes "
            f"each; median {np.median(self.loop_ms):.0f} ms, {share:.2f} of matching; refused "
            f"{self.search.refused}"
        )


def poses(source: FrameSequence[StereoFrame], T_map_base: np.ndarray) -> np.ndarray:
    """(N, 4, 4) exact poses of the left camera, in the first one."""
    T = T_map_base @ left_in_base_link(source.rig).matrix
    return inverted(T[0]) @ T


def drifting(T: np.ndarray) -> np.ndarray:
    """The path with drift."""
    rng, path = np.random.default_rng(0), [np.eye(4)]
    for i in range(1, len(T)):
        step = inverted(T[i - 1]) @ T[i]
        path.append(path[-1] @ step @ exp_twist(DRIFT + DRIFT_SIGMA * rng.normal(size=6)))
    return np.stack(path)


def off_m(T: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(N,) distances."""
    return np.linalg.norm(T[:, :3, 3] - truth[:, :3, 3], axis=1)


def gaps_m(T: np.ndarray, truth: np.ndarray, apart: int) -> np.ndarray:
    """(N,) errors of where the second round is, seen from the first."""
    seen = [
        np.stack([inverted(path[i]) @ path[i + apart] for i in range(len(path) - apart)])
        for path in (T, truth)
    ]
    return off_m(*seen)


def metres(row: str, value: float, wanted: float, *, least: bool = False) -> Figure:
    """A length that is judged."""
    return Figure(row, float(value), wanted, least=least, form="{:.3f} m")


def block() -> Iterator[Figure]:
    """Twice round the block."""
    source = Synthetic("block", frames=2 * ROUND, width_px=WIDTH_PX).open()
    indices = list(range(0, 2 * ROUND, EVERY))
    truth = poses(source, source.trajectory.T_world_body[::EVERY])
    drift = drifting(truth)
    finding = Finding(LoopFinder().start(source.rig))
    times = []
    for index, T in zip(indices, drift, strict=True):
        frame = source.load(index)
        times.append(frame.timestamp_ns)
        finding.add(frame, T)
    say(f"block: {finding.line()}")
    errors = [
        log_twist(
            inverted(inverted(truth[one.earlier.index // EVERY]) @ truth[one.later.index // EVERY])
            @ one.T_earlier_later
        )
        for one in finding.loops
    ]
    errors_m = [np.linalg.norm(error[:3]) for error in errors]
    later = {one.later.index for one in finding.loops}
    say(
        f"  {len(later)} of {len(indices) // 2} keyframes of the second round have a loop; off by "
        f"{np.median(errors_m):.3f} m, at most {max(errors_m, default=np.nan):.3f} m"
    )
    yield metres("block, loops: off by", max(errors_m, default=np.nan), CLOSED_M)
    path = closed([Trajectory(np.array(times, np.int64), drift)], finding.loops)
    T = path.trajectories[0].T_world_body
    apart = ROUND // EVERY
    for name, one in (("odometry", drift), ("closed", T)):
        end_m, gap_m = off_m(one, truth)[-1], gaps_m(one, truth, apart).max()
        say(
            f"  {name:8s} end off by {end_m:.2f} m, rms "
            f"{np.sqrt(np.mean(off_m(one, truth) ** 2)):.2f} m, second round against first at "
            f"most {gap_m:.3f} m"
        )
        drifts, most = name == "odometry", DRIFT_M if name == "odometry" else CLOSED_M
        yield metres(f"block, {name}: end off by", end_m, most, least=drifts)
        yield metres(f"block, {name}: second round against first", gap_m, most, least=drifts)
    say(f"  {len(path.used)} loops used, {len(path.dropped)} dropped")


def streets() -> Iterator[Figure]:
    """Ten streets that never come back; far more candidates are tried than by default."""
    rig = Synthetic("street", width_px=WIDTH_PX).open().rig
    finding = Finding(LoopFinder(candidates=5, similarity=0.0).start(rig))
    for seed in range(10):
        source = Synthetic("street", frames=125, width_px=WIDTH_PX, seed=seed).open()
        truth = poses(source, source.trajectory.T_world_body[::5])
        for at, T in zip(range(0, 125, 5), truth, strict=True):
            frame = source.load(at)
            time_ns = frame.timestamp_ns + seed * DAY_NS
            later = replace(frame, index=1000 * seed + at, timestamp_ns=time_ns)
            finding.add(later, T, piece=seed)
    say(f"ten streets: {len(finding.loops)} loops; {finding.line()}")
    yield Figure("ten streets: loops", len(finding.loops), 0, form="{:.0f}")


def kitti(data: Path) -> Iterator[Figure]:
    """KITTI 06, and again."""
    source = KittiOdometry(str(data / "kitti_odometry")).open()
    indices = list(range(0, 51, 3))
    frames = [source.load(i) for i in indices]
    truth = poses(source, np.stack([frame.pose.matrix for frame in frames]))
    finding = Finding(LoopFinder().start(source.rig))
    for frame, T in zip(frames, truth, strict=True):
        finding.add(frame, T)
    say(f"KITTI 06: {len(finding.loops)} loops; {finding.line()}")
    yield Figure("KITTI 06: loops", len(finding.loops), 0, form="{:.0f}")
    finding = Finding(LoopFinder().start(source.rig))
    for i in range(0, len(indices), 2):
        finding.add(frames[i], truth[i])
    for i, frame in again(frames):
        finding.add(frame, truth[i], piece=1)
    at = {index: i for i, index in enumerate(indices)}
    errors_m = [
        np.linalg.norm(
            log_twist(
                inverted(inverted(truth[at[one.earlier.index]]) @ truth[at[one.later.index]])
                @ one.T_earlier_later
            )[:3]
        )
        for one in finding.loops
    ]
    say(
        f"KITTI 06 again: {len({one.later.index for one in finding.loops})} of "
        f"{len(indices) // 2} keyframes have a loop, off by at most "
        f"{max(errors_m, default=np.nan):.3f} m; {finding.line()}"
    )
    yield metres("KITTI 06 again, loops: off by", max(errors_m, default=np.nan), CLOSED_M)


def again(frames: list[StereoFrame]) -> Iterator[tuple[int, StereoFrame]]:
    """Every second frame, darker and with noise, as if of another day."""
    rng = np.random.default_rng(0)
    for i in range(1, len(frames), 2):
        frame = frames[i]
        eyes = [
            np.clip(0.85 * eye + 8.0 + rng.normal(0.0, 4.0, eye.shape), 0, 255).astype(np.uint8)
            for eye in (frame.left, frame.right)
        ]
        time_ns = frame.timestamp_ns + DAY_NS
        yield i, replace(frame, left=eyes[0], right=eyes[1], timestamp_ns=time_ns)


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main(arguments: list[str]) -> None:
    """Print the figures; exit with 1 where they are not as wanted."""
    import cv2

    cv2.setNumThreads(1)
    figures = [figure for data in arguments for figure in kitti(Path(data))]
    end([*figures, *block(), *streets()])


if __name__ == "__main__":
    main(sys.argv[1:])
