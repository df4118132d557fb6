"""The baseline for tracks: boxes of the picture followed by their overlap, without depth.

A Kalman filter of the box's middle, area and shape, Hungarian assignment by IoU (Bewley et al.,
Simple online and realtime tracking, 2016); how often a track must be seen and how long it lives
unseen are the 3D tracker's. Its velocities are what a script makes of such identities: the change
of the measured place since the last frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from pseudolidar.evaluation.tracks import ToldTrack
from pseudolidar.obstacles.overlap import box_iou
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

LEAST_IOU = 0.3
# SORT's noises: of the state's changes a frame, of the measurement, and of the start.
CHANGE = np.diag([1.0, 1.0, 1.0, 1.0, 0.01, 0.01, 1e-4])
SEEN_AS = np.diag([1.0, 1.0, 10.0, 10.0])
START = np.diag([10.0, 10.0, 10.0, 10.0, 1e4, 1e4, 1e4])
F = np.eye(7) + np.eye(7, k=4)
H = np.eye(4, 7)


@dataclass(eq=False)
class PictureTrack:
    """One box of the picture over time."""

    number: int
    mean: Float64
    covariance: Float64
    seen: int
    last_ns: int
    place: Float64
    velocity: Float64 | None = None


class IouTracker:
    """Fed frame by frame."""

    def __init__(self, *, confirm: int, coast_s: float) -> None:
        self.confirm, self.coast_s = confirm, coast_s
        self.tracks: list[PictureTrack] = []
        self.next = 1

    def __call__(
        self, obstacles: Sequence[Obstacle], timestamp_ns: int, T_map_camera: Pose
    ) -> list[ToldTrack]:
        for one in self.tracks:
            if one.mean[2] + one.mean[6] <= 0:
                one.mean[6] = 0.0
            one.mean, one.covariance = F @ one.mean, F @ one.covariance @ F.T + CHANGE
        overlap = np.array(
            [[box_iou(_box(t.mean), o.detection.box_px) for o in obstacles] for t in self.tracks]
        ).reshape(len(self.tracks), len(obstacles))
        told, left = [], set(range(len(obstacles)))
        for row, column in zip(*linear_sum_assignment(-overlap), strict=True):
            if overlap[row, column] >= LEAST_IOU:
                left.discard(int(column))
                one = self.tracks[row]
                self._update(one, obstacles[column], timestamp_ns, T_map_camera)
                if one.seen >= self.confirm:
                    told.append(_told(one, obstacles[column], T_map_camera))
        self.tracks = [t for t in self.tracks if timestamp_ns - t.last_ns <= self.coast_s * 1e9]
        for column in sorted(left):
            mean = np.concatenate([_measured(obstacles[column]), np.zeros(3)])
            place = T_map_camera.apply(obstacles[column].box.pose.translation_m[None])[0]
            self.tracks.append(PictureTrack(self.next, mean, START, 1, timestamp_ns, place))
            self.next += 1
        return told

    def _update(self, one: PictureTrack, obstacle: Obstacle, now_ns: int, T: Pose) -> None:
        S = H @ one.covariance @ H.T + SEEN_AS
        gain = one.covariance @ H.T @ np.linalg.inv(S)
        one.mean = one.mean + gain @ (_measured(obstacle) - H @ one.mean)
        one.covariance = (np.eye(7) - gain @ H) @ one.covariance
        place = T.apply(obstacle.box.pose.translation_m[None])[0]
        one.velocity = (place - one.place) / ((now_ns - one.last_ns) / 1e9)
        one.place, one.last_ns, one.seen = place, now_ns, one.seen + 1


def _told(one: PictureTrack, obstacle: Obstacle, T: Pose) -> ToldTrack:
    velocity = None if one.velocity is None else T.matrix[:3, :3].T @ one.velocity
    return ToldTrack(one.number, obstacle.box, velocity, box_px=obstacle.detection.box_px)


def _measured(obstacle: Obstacle) -> Float64:
    left, top, right, bottom = obstacle.detection.box_px
    wide, tall = max(right - left, 1e-3), max(bottom - top, 1e-3)
    return np.array([(left + right) / 2, (top + bottom) / 2, wide * tall, wide / tall])


def _box(mean: Float64) -> tuple[float, float, float, float]:
    wide = float(np.sqrt(max(mean[2] * mean[3], 1e-6)))
    tall = max(float(mean[2]), 1e-6) / wide
    x, y = float(mean[0]), float(mean[1])
    return x - wide / 2, y - tall / 2, x + wide / 2, y + tall / 2
