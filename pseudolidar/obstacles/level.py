"""Axes that are level: x right, y down, z ahead, the ground's normal up."""

from __future__ import annotations

import numpy as np

from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import AnyArray, Float64

CAMERA_UP = np.array([0.0, -1.0, 0.0])


def level_axes(sight: Sight) -> Float64:
    """(3, 3) rotation from `camera_left` to level axes; a camera without ground is level."""
    up = CAMERA_UP if sight.ground is None else sight.ground.normal
    ahead = np.array([0.0, 0.0, 1.0])
    ahead = ahead - (ahead @ up) * up
    length = float(np.linalg.norm(ahead))
    if length < 1e-6:  # it looks straight down: its picture's up is ahead
        ahead, length = CAMERA_UP - (CAMERA_UP @ up) * up, 1.0
    ahead = ahead / length
    return np.stack([np.cross(-up, ahead), -up, ahead])


def turned(R: Float64, xyz: AnyArray) -> Float64:
    """(N, 3) points in axes turned by R; sums by numpy, which rounds alike on every machine."""
    x, y, z = xyz.astype(np.float64).T
    return np.stack([r[0] * x + r[1] * y + r[2] * z for r in R], axis=1)
