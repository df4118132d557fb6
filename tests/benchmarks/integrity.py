"""Wrong steps of vision that fused odometry finds out: every eighth step is made wrong.

    python -m tests.benchmarks.integrity [DATA]

On KITTI odometry 06, drive 0002 and rendered worlds; steps are halved, 1.3 times too long, or
turned by 1.5 degrees. Vision and matching run once for each sequence. What is not caught as often
as is wanted, false alarms, and fused paths worse than vision's are named, and end it with 1.
"""

import os
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import exp_twist, inverted
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.mapping.fused_chain import FusedChain
from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from tests.benchmarks.judging import Figure, end

EVERY = 8
TURN = exp_twist(np.radians([0.0, 0.0, 0.0, 0.0, 1.5, 0.0]))
WORLDS = ("street", 3), ("street", 5), ("room", 0), ("flight", 0), ("flight", 2)

# What is wanted: shares that are caught at least, of how many in all; how much worse fused may be
# than vision where nothing was made wrong.
CAUGHT = {"halved": 0.8, "x1.3": 0.9, "yaw": 0.9}
INJECTED, WORSE_REL = 50, 0.001


def longer(factor):
    """A fault that makes steps longer by a factor."""
    return lambda T: np.block([[T[:3, :3], factor * T[:3, 3:]], [T[3:]]])


FAULTS = {
    "none": lambda T: T,
    "halved": longer(0.5),
    "x1.3": longer(1.3),
    "yaw": lambda T: T @ TURN,
}


class Faulty:
    """Tells what vision told before, every eighth step of it made wrong."""

    correction, offset = None, Offset()

    def __init__(self, states, fault):
        self.states = iter(enumerate(states))
        self.fault = fault

    def register(self, *_):
        """The next state."""
        number, state = next(self.states)
        if state.step is None or number % EVERY != EVERY - 1:
            return state
        return replace(state, step=replace(state.step, T_from_to=self.fault(state.step.T_from_to)))


def sequences(data):
    """Names and sources."""
    yield "06", KittiOdometry(str(data / "kitti_odometry")).open()
    yield "drive 0002", KittiRaw(str(data / "kitti_raw")).open()
    for world, seed in WORLDS:
        yield f"{world} {seed}", Synthetic(world, frames=26, seed=seed).open()


def chained(steps):
    """The pose at the end of steps."""
    T = np.eye(4)
    for step in steps:
        T = T @ step
    return T


def main(data):
    """Print each run, and what was caught of all; exit with 1 where that is not as wanted."""
    made, caught, alarms, asked_ratio, wrong_ratio = Counter(), Counter(), 0, [], []
    figures = []
    for name, source in sequences(data):
        frames = [source.load(i) for i in range(len(source.ids))]
        match = Census().load()
        disparities = [match(frame) for frame in frames]
        vision = VisualOdometry().start(source.rig)
        states = [vision.register(*both) for both in zip(frames, disparities, strict=True)]
        T_base_left = left_in_base_link(source.rig).matrix
        truth = [frame.pose.matrix @ T_base_left for frame in frames]
        truth = [inverted(truth[0]) @ T for T in truth]
        length_m = np.linalg.norm(np.diff([T[:3, 3] for T in truth], axis=0), axis=1).sum()
        injected = {i for i in range(len(frames)) if i % EVERY == EVERY - 1}
        for kind, fault in FAULTS.items():
            fused = FusedChain(Faulty(states, fault), source.rig, reach=VisualOdometry().reach)
            began = time.perf_counter()
            told = [fused.register(*both) for both in zip(frames, disparities, strict=True)]
            ms = 1e3 * (time.perf_counter() - began) / len(frames)
            checks = {i: one.check for i, one in enumerate(told) if one.check}
            wrong = {i for i, check in checks.items() if check.wrong}
            faulty = injected if kind != "none" else set()
            for i, check in checks.items():
                if check.asked == "pictures":
                    ratio = (1 - check.vision_agrees) / (1 - check.other_agrees)
                    (wrong_ratio if i in faulty else asked_ratio).append(ratio)
            made[kind] += len(faulty)
            caught[kind] += len(wrong & faulty)
            alarms += len(wrong - faulty)
            alone = Faulty(states, fault)
            steps = [alone.register(*both).step for both in zip(frames, disparities, strict=True)]
            ends = [
                chained([step.T_from_to for step in steps if step]),
                told[-1].state.T_odom_camera.matrix,
            ]
            errors = [np.linalg.norm((T - truth[-1])[:3, 3]) / length_m for T in ends]
            print(
                f"{name:11} {kind:7} end error: vision {errors[0]:.2%}, fused {errors[1]:.2%}; "
                f"caught {len(wrong & faulty)} of {len(faulty)}; {ms:.0f} ms beside vision",
                flush=True,
            )
            if kind == "none":
                row = f"{name}: fused worse than vision by"
                figures.append(Figure(row, errors[1] - errors[0], WORSE_REL))
    for kind in FAULTS:
        if made[kind]:
            print(f"{kind}: {caught[kind]} of {made[kind]} caught")
    print(f"false alarms: {alarms}; right steps that pictures were asked about: {len(asked_ratio)}")
    print(f"disagreement by wrong steps over that by others: {min(wrong_ratio):.2f} at least")
    figures += [
        Figure(f"{kind}: caught", caught[kind] / made[kind], least, least=True, form="{:.0%}")
        for kind, least in CAUGHT.items()
    ]
    figures.append(Figure("injections", made.total(), INJECTED, least=True, form="{:.0f}"))
    figures.append(Figure("false alarms", alarms, 0, form="{:.0f}"))
    end(figures)


if __name__ == "__main__":
    asked = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("PSEUDOLIDAR_DATA")
    main(Path(asked or Path(__file__).parents[2].parent / "shared" / "data"))
