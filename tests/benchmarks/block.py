"""The whole program twice round a rendered block, by what its cameras see.

    python -m tests.benchmarks.block [FOLDER] [WIDTH]

FOLDER keeps the rendered frames (2 x 320, 640 px wide; 11 minutes on one core) for the next time.
`pseudolidar map --odometry vision` then goes along them with the right calibration, and with one
whose focal length is 1.5 % too long or too short: turns come out wrong, and the path drifts. No
drift is put in. Each with loops and without: matched once (4 minutes for each calibration). What
drifts by 2 m and is not closed to 0.2 m is named, and ends it with 1.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.trajectory import read_kitti_poses
from pseudolidar.geometry.twists import inverted
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.structures.camera import Camera, StereoRig
from tests.benchmarks.judging import Figure, end

PROGRAM = "import sys; from pseudolidar.cli import main; sys.exit(main())"
ROUND, WIDTH_PX = 320, 640
FOCAL_FACTORS = (1.0, 1.015, 0.985)
# What is wanted: a drift of so much at least, m, is closed to so much at most.
DRIFT_M, CLOSED_M = 2.0, 0.2


def program(*arguments: str) -> dict[str, object]:
    """What a verb says."""
    command = [sys.executable, "-c", PROGRAM, *arguments, "--json"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    return json.loads(done.stdout)


def of_focal_length(rig: StereoRig, factor: float) -> StereoRig:
    """The rig as a calibration has it that is off by a factor."""

    def camera(one: Camera) -> Camera:
        K = one.K.copy()
        K[:2, :2] *= factor
        return replace(one, K=K)

    return replace(rig, left=camera(rig.left), right=camera(rig.right))


def gaps_m(T: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(N,) how far the second round is off, seen from the first."""
    apart = [
        np.stack([inverted(path[i]) @ path[i + ROUND] for i in range(len(path) - ROUND)])
        for path in (T, truth)
    ]
    return np.linalg.norm(apart[0][:, :3, 3] - apart[1][:, :3, 3], axis=1)


def main(folder: Path, width_px: int) -> None:
    """Print the figures; exit with 1 where they are not as wanted."""
    figures = []
    drive = folder / f"block_{width_px}"
    frames, width = str(2 * ROUND), str(width_px)
    world = ("--world", "block", "--layout", "odometry", "--frames", frames, "--width-px", width)
    program("synth", str(drive), *world)
    source = KittiOdometry(str(drive)).open()
    (poses,) = drive.rglob("poses/*.txt")
    truth = read_kitti_poses(poses)
    for factor in FOCAL_FACTORS:
        rig, out = folder / f"rig_{factor}.json", folder / f"out_{width_px}_{factor}"
        write_rig(rig, of_focal_length(source.rig, factor))
        for loops in ("none", "loop-finder"):
            more = ("--rig", str(rig), "--odometry", "vision", "--loops", loops, "--to", "none")
            told = program("map", str(drive), f"{out}_{loops}", *more, "--no-check")
            path = told["trajectory"]
            gaps = gaps_m(read_kitti_poses(Path(f"{out}_{loops}") / "trajectory_kitti.txt"), truth)
            end_m = path["end_error_rel"] * path["length_m"]
            print(
                f"focal length x {factor:<5}  {len(path['loops']):2d} loops  second round against "
                f"the first: median {np.median(gaps):.3f} m, at most {gaps.max():.3f} m; end off "
                f"by {end_m:.2f} m, APE {path['ape_rmse_m']:.3f} m; {path['pieces']} piece",
                flush=True,
            )
            figures += judged(f"focal length x {factor}, {loops}", factor, loops, end_m, gaps.max())
    end(figures)


def judged(row: str, factor: float, loops: str, end_m: float, gap_m: float) -> list[Figure]:
    """What is wanted of a run: that it drifts where it should, and that loops close it."""
    if loops == "none" and factor == 1.0:
        return []
    drifts = loops == "none"
    most = DRIFT_M if drifts else CLOSED_M
    return [
        Figure(f"{row}: {what}", float(value), most, least=drifts, form="{:.3f} m")
        for what, value in (("end off by", end_m), ("second round against first", gap_m))
    ]


if __name__ == "__main__":
    asked = sys.argv[1:]
    with tempfile.TemporaryDirectory() as made:
        main(Path(asked[0] if asked else made), int(asked[1]) if len(asked) > 1 else WIDTH_PX)
