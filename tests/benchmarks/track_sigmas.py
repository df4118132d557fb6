"""Whether error bars of tracks are honest: by range, in rendered streets, with a rig that is off.

    python -m tests.benchmarks.track_sigmas [SEEDS]

Streets are measured as in `measured_tracks`. Their rig is perfect, where sigmas reckon with one
that is off by its systematic error: distances are moved as such rigs would have measured them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.tracks import TrueObject, same
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose
from tests.benchmarks.measured_tracks import street
from tests.benchmarks.tracks import told
from tests.obstacles.junction import Moment

SEEDS = (5, 7)
# By how many of its sigmas the rig is off.
RIGS = (-1.0, -0.3, 0.3, 1.0)
BANDS_M = ((0, 15), (15, 30), (30, 50), (50, 75))
FIGURES = ("place along ray", "across", "velocity x", "velocity z")


def moved(one: Obstacle, rig: float) -> Obstacle:
    """As a rig that is off by so many sigmas would have measured it."""
    if not one.sigma_shared_m:
        return one
    # d' = d + rig sigma_px, z' = fB / d', and sigma_shared_m = sigma_px z^2 / fB
    z = one.distance_m
    nearer = 1.0 / max(1.0 + rig * one.sigma_shared_m / z, 0.1)
    centre = one.box.pose.translation_m
    centre = centre + (nearer - 1.0) * z * centre / centre[2]
    pose = Pose.from_rotation("camera_left", "box", one.box.pose.matrix[:3, :3], centre)
    return replace(
        one,
        distance_m=nearer * z,
        sigma_shared_m=nearer**2 * one.sigma_shared_m,
        box=replace(one.box, pose=pose),
    )


def samples(frames: Sequence[Moment], rig: float) -> Iterator[Float64]:
    """(9,) of each thing in each frame: range, then error and sigma of each figure."""
    follow, last = Tracker().load(), dict[int, int]()
    for frame in frames:
        obstacles = [moved(one, rig) for one in frame.obstacles]
        tracks = told(follow(obstacles, frame.timestamp_ns, frame.T_map_camera))
        for row, column in same(frame.truth, tracks, last):
            one, track = frame.truth[row], tracks[column]
            last[one.number] = track.number
            if one.seen and track.velocity_m_s is not None:
                assert track.sigma_velocity_m_s is not None
                off = track.velocity_m_s - one.velocity_m_s
                sigma = track.sigma_velocity_m_s
                place = _place(one, track.box)
                yield np.array([*place, off[0], sigma[0], off[2], sigma[2]])


def _place(one: TrueObject, box: Box3D) -> tuple[float, float, float, float, float]:
    """Range, error and sigma along the ray, error and sigma across it."""
    assert box.sigma_m is not None
    centre, R = one.box.pose.translation_m, box.pose.matrix[:3, :3]
    off, range_m = box.pose.translation_m - centre, float(np.linalg.norm(centre))
    ray, side = centre / range_m, np.array([centre[2], 0.0, -centre[0]])
    side /= np.linalg.norm(side)
    along, across = (float(np.linalg.norm((axis @ R) * box.sigma_m[:3])) for axis in (ray, side))
    return range_m, float(off @ ray), along, float(off @ side), across


def main(*seeds: int) -> None:
    """Print the table: median error, share within 1 and 2 sigma, mean of (error / sigma)^2."""
    streets = [street(seed) for seed in seeds or SEEDS]
    rows = np.array([one for frames in streets for rig in RIGS for one in samples(frames, rig)])
    print("   range  things  " + "".join(f"{name:32s}" for name in FIGURES))
    for near, far in BANDS_M:
        band = rows[(rows[:, 0] >= near) & (rows[:, 0] < far)]
        if not len(band):
            continue
        line = f"{near:3d}-{far:2d} m {len(band):6d}  "
        for k in range(1, 9, 2):
            off = np.abs(band[:, k] / band[:, k + 1])
            line += f"{np.median(np.abs(band[:, k])):5.2f} {np.mean(off <= 1):5.0%} "
            line += f"{np.mean(off <= 2):5.0%} {np.mean(off**2):6.2f}       "
        print(line)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
