"""Tracks of a rig that moves through points, computed without pictures; offsets can be planted."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.point_tracks import PointTracks
from pseudolidar.structures.pose import Pose

STEP = np.array([0.02, -0.03, -2.5, 0.004, -0.01, 0.002])  # 2.5 m forwards, a slight turn


def rig(*, doffs_px: float = 0.0, fy_px: float = 700.0) -> StereoRig:
    K = np.array([[700.0, 0, 610.0], [0, fy_px, 180.0], [0, 0, 1]])
    K_right = K + np.array([[0, 0, doffs_px], [0, 0, 0], [0, 0, 0]])
    left = Camera(K, 1242, 375)
    right = Camera(K_right, 1242, 375, frame="camera_right")
    baseline = Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.54, 0, 0]))
    return StereoRig(left, right, baseline)


def observed(points: np.ndarray, of: StereoRig) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and disparities by the two projection matrices."""
    homogeneous = np.column_stack([points, np.ones(len(points))])
    left, right = (homogeneous @ P.T for P in (of.P_left, of.P_right))
    left, right = left[:, :2] / left[:, 2:], right[:, :2] / right[:, 2:]
    return left, left[:, 0] - right[:, 0]


def tracks(
    of: StereoRig,
    T: np.ndarray,
    *,
    n: int = 400,
    depths_m: tuple[float, float] = (6.0, 80.0),
    offset_px: float = 0.0,
    bend_px: float = 0.0,
    noise_px: float = 0.0,
    outliers: float = 0.0,
    seed: int = 0,
) -> PointTracks:
    """What both eyes see before and after, with `offset_px (1 + x^2) + bend_px x^2` too much."""
    rng = np.random.default_rng(seed)
    z = 1 / rng.uniform(1 / depths_m[1], 1 / depths_m[0], n)
    uv = rng.uniform((0, 0), of.left.size_px, (n, 2))
    points = np.column_stack([uv, np.ones(n)]) @ np.linalg.inv(of.left.K).T * z[:, None]
    seen = []
    for at in (points, points @ T[:3, :3].T + T[:3, 3]):
        where, d = observed(at, of)
        x = (where[:, 0] - of.left.K[0, 2]) / of.left.K[0, 0]
        d = d + offset_px * (1 + x**2) + bend_px * x**2 + rng.normal(0, noise_px, n)
        seen += [where + rng.normal(0, noise_px, (n, 2)) * (at is not points), d]
    wrong = rng.random(n) < outliers
    seen[2][wrong] += rng.uniform(3, 20, (wrong.sum(), 2))
    return PointTracks(*seen)


def motions_of(
    of: StereoRig, count: int, **options: object
) -> list[tuple[np.ndarray, PointTracks]]:
    """Several motions with different tracks."""
    turns = np.random.default_rng(5).normal(0, 0.003, (count, 3))
    Ts = [exp_twist(STEP + np.concatenate([np.zeros(3), turn])) for turn in turns]
    return [(T, tracks(of, T, seed=seed, **options)) for seed, T in enumerate(Ts)]  # type: ignore[arg-type]
