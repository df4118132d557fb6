"""Tracks of obstacles that are really measured: in rendered streets, a car crossing.

    python -m tests.benchmarks.measured_tracks [SEEDS]

Pairs are rendered, matched and measured as `pseudolidar obstacles` does, with the labels' boxes as
detections, nothing missed; poses, identities and velocities are exact. Judged are objects to 60 m
that are seen for the most part. 2D tracking is given the same.
"""

from __future__ import annotations

import sys

import numpy as np

from pipelines.obstacles import Obstacles, finder, opened
from pseudolidar.evaluation.tracks import TrueObject, pooled
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.obstacles.motion_filter import Straight
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.sources.worlds.street import Street
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from tests.benchmarks.tracks import HEAD, line, score, score_2d
from tests.obstacles.junction import Moment

SEEDS, TO_M = (0, 2), 60.0
# A car comes out of the side street of every seed in these frames, at 10 Hz.
FRAMES = range(42, 76)
STEP_S = 0.01


def street(seed: int) -> list[Moment]:
    """Frames of a street, with the truth beside."""
    job = Obstacles(Synthetic("street", frames=FRAMES.stop, seed=seed))
    source = opened(job)
    per_frame = finder(job, source)
    frames = []
    for index in FRAMES:
        frame = source.load(index)
        assert isinstance(frame, StereoFrame)
        assert frame.pose is not None
        T = frame.pose @ left_in_base_link(frame.rig)
        obstacles = per_frame.found(frame).obstacles
        frames.append(Moment(frame.timestamp_ns, T, obstacles, truth(seed, frame, T)))
    return frames


def truth(seed: int, frame: StereoFrame, T_map_camera: Pose) -> tuple[TrueObject, ...]:
    """Labels with the velocities of the world; what stands still there has none."""
    world = Street(seed=seed)
    t_s = (frame.timestamp_ns - 1_000_000_000) / 1e9
    before, after = (
        {a.thing.number: a.thing for a in world.actors(t_s + s)} for s in (-STEP_S, STEP_S)
    )
    R_camera_world = T_map_camera.matrix[:3, :3].T @ world.T_world_base(0.0)[:3, :3].T

    def velocity(number: int) -> Float64:
        if number not in before or number not in after:
            return np.zeros(3)
        way = after[number].T_world_box[:3, 3] - before[number].T_world_box[:3, 3]
        return np.asarray(R_camera_world @ way / (2 * STEP_S))

    return tuple(
        TrueObject(
            label.track_id,
            label.box,
            velocity(label.track_id),
            seen=(label.occlusion or 0) <= 1 and bool(label.box.pose.translation_m[2] < TO_M),
            box_px=label.detection.box_px,
        )
        for label in frame.labels or ()
        if label.box is not None and label.track_id is not None
    )


def main(*seeds: int) -> None:
    """Print the table."""
    streets = [street(seed) for seed in seeds or SEEDS]
    print(f"{'':22s} {HEAD}")
    straight = Tracker(motion=Straight())
    print(line("3D, turning", pooled([score(Tracker(), frames) for frames in streets])))
    print(line("3D, straight", pooled([score(straight, frames) for frames in streets])))
    print(line("2D by overlap", pooled([score_2d(frames) for frames in streets])), flush=True)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
