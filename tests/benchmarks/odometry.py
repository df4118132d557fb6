"""Visual odometry against the poses of sources, and its time beside the matcher's.

    python -m tests.benchmarks.odometry [NAME ...]

Names: 06 and 0002 (KITTI, from the folder of real data), street, room, flight; all by default.
"told" are poses as they were told frame by frame, "settled" the path when all is known of the
disparity offset. t_rel is the mean over all pieces of 10, 20, 30, 40 m, or of the whole path where
that is shorter (`evaluation/trajectory`). Time is CPU time of one thread, matcher and odometry in
turns on the same frames; NEES is the normalised squared error of steps by its six dimensions.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np

from pseudolidar.mapping.visual_odometry import VisualChain, VisualOdometry
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.source import FrameSequence
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean, Cleaner
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import OdometryState
from tests.conftest import DATA
from tests.mapping.worlds import Drive, drift

FRAMES = {"street": 40, "room": 60, "flight": 40}
# Each world in so many versions.
SEEDS = 3


@dataclass(frozen=True, eq=False)
class Driven:
    """What odometry told of a sequence."""

    drive: Drive
    states: list[OdometryState]
    chain: VisualChain
    match_ms: list[float]
    vision_ms: list[float]


def sources(name: str) -> list[FrameSequence[StereoFrame]]:
    """The sequences of a name."""
    if name == "06":
        return [KittiOdometry(str(DATA / "kitti_odometry")).open()]
    if name == "0002":
        return [KittiRaw(str(DATA / "kitti_raw")).open()]
    return [Synthetic(name, frames=FRAMES[name], seed=seed).open() for seed in range(SEEDS)]


def driven(source: FrameSequence[StereoFrame]) -> Driven:
    """Match and follow all frames, in turns."""
    match, clean = Census().load(), Cleaner.load(Clean())
    frames = [source.load(i) for i in range(len(source.ids))]
    chain = VisualOdometry().start(frames[0].rig)
    states, match_ms, vision_ms = [], [], []
    for frame in frames:
        start = time.process_time()
        disparity = clean(frame, match(frame)).disparity
        matched = time.process_time()
        states.append(chain.register(frame, disparity))
        match_ms.append(1e3 * (matched - start))
        vision_ms.append(1e3 * (time.process_time() - matched))
    return Driven(Drive.of(frames), states, chain, match_ms, vision_ms)


def line(name: str, one: Driven) -> str:
    """One row of the table."""
    told = np.stack([state.T_odom_camera.matrix for state in one.states])
    (path,) = one.chain.trajectories()
    truth = one.drive.T_odom
    first, settled = drift(told, truth), drift(path.T_world_body, truth)
    keys = sum(state.keyframe for state in one.states)
    vision, match = np.mean(one.vision_ms[2:]), np.mean(one.match_ms[2:])
    return (
        f"{name:9s} {one.drive.length_m:6.1f} m  told {first.end_rel:6.2%} {first.t_rel:6.2%}  "
        f"settled {settled.end_rel:6.2%} {settled.t_rel:6.2%} {settled.r_deg_per_m:.4f} deg/m  "
        f"offset {one.chain.offset.offset_px:+.2f} px  NEES "
        f"{np.mean(one.drive.step_nees(one.states)):6.2f}  keyframes {keys:2d} of {len(told)}  "
        f"{vision:3.0f} ms, {vision / match:.2f} of matching"
    )


def main(names: list[str]) -> None:
    """Print the table."""
    import cv2

    cv2.setNumThreads(1)
    say("sequence  length    end, t_rel of the poses")
    for name in names or ["06", "0002", *FRAMES]:
        for number, source in enumerate(sources(name)):
            say(line(f"{name} {number}" if name in FRAMES else name, driven(source)))


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
