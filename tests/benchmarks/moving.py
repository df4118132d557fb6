"""Odometry where something large moves by itself and nobody masks it.

    python -m tests.benchmarks.moving [WORLD ...] [--seeds 5,7] [--shares 0.3,0.45,0.6]

Worlds: street, room, flight, block. A textured board covers a share of the picture's width, from
the first frame on or from the sixth: it stays where it is in the picture (`still`, as a bus that
drives beside), goes `across`, or comes `near`. It is in the pictures, their exact disparities and
the scans. End error by the length of the way, of vision, of fused without scans, and with them.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

from pseudolidar.mapping.odometry import Fused, Odometry, Vision
from pseudolidar.mapping.registered import Registered
from pseudolidar.structures.frame import StereoFrame
from tests.mapping.moving_board import KINDS, with_board
from tests.mapping.worlds import Drive

FRAMES, WIDTH_PX = 12, 620
BEGINS = 0, 5


def followed(odometry: Odometry, frames: list[StereoFrame]) -> list[Registered]:
    """What it tells of each frame."""
    chain = odometry.start(frames[0].rig)
    return [chain.register(frame, frame.truth) for frame in frames]


def verdict(drive: Drive, told: list[Registered]) -> str:
    """End error in percent, and what was said."""
    lost = sum(not one.state.measured for one in told)
    if told[-1].state.piece:
        return f"{told[-1].state.piece + 1} pieces"
    last = max(i for i, one in enumerate(told) if one.state.T_odom_camera is not None)
    wrong = sum(bool(one.check and one.check.wrong) for one in told)
    said = f"{100 * drive.error_rel(told[last].state, at=last):6.2f}"
    return said + (f" {lost} lost" if lost else "") + (f" {wrong} caught" if wrong else "")


def verdicts(drive: Drive, frames: list[StereoFrame]) -> list[str]:
    """Of the three that can follow them."""
    blind = [replace(frame, scan=None) for frame in frames]
    runs = (Vision(), blind), (Fused(), blind), (Fused(), frames)
    return [verdict(drive, followed(odometry, some)) for odometry, some in runs]


def main(arguments: list[str]) -> None:
    """Print a line for each board."""
    import cv2

    cv2.setNumThreads(1)
    parser = argparse.ArgumentParser()
    parser.add_argument("worlds", nargs="*", default=["street"])
    parser.add_argument("--seeds", default="5,7")
    parser.add_argument("--shares", default="0.3,0.45,0.6")
    asked = parser.parse_args(arguments)
    for world in asked.worlds:
        for seed in map(int, asked.seeds.split(",")):
            drive = Drive.through(world, FRAMES, seed=seed, width_px=WIDTH_PX)
            title = f"{world} {seed}"
            say(title, "no board", verdicts(drive, drive.frames))
            for share in map(float, asked.shares.split(",")):
                for kind in KINDS:
                    for begin in BEGINS:
                        frames = with_board(drive.frames, kind, share, begin=begin, seed=begin)
                        what = f"{kind} {share:.0%} from {begin}"
                        say(title, what, verdicts(drive, frames))


def say(title: str, what: str, said: list[str]) -> None:
    """Print a line at once."""
    names = "vision", "fused", "with scans"
    cells = " | ".join(f"{name} {one}" for name, one in zip(names, said, strict=True))
    sys.stdout.write(f"{title:9s} {what:18s} {cells}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
