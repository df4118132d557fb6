"""Obstacles as they come from a street, made by hand: tracked, not tracked, of two words."""

from __future__ import annotations

import math

import numpy as np

from pseudolidar.structures.box import Box3D, Contact, Detection, Track
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

SIGMA = np.array([0.21, 0.1, 0.05, 0.3, 0.1, 0.06])


def upright(x: float, y: float, z: float, heading_rad: float) -> Pose:
    """`T_camera_left_box` of a box on level ground whose length points at `heading_rad`."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    R = np.array([[s, -c, 0.0], [0.0, 0.0, -1.0], [c, s, 0.0]])
    return Pose.from_rotation("camera_left", "box", R, np.array([x, y, z]))


def car(*, track: bool = True) -> Obstacle:
    """Of 4 x 1.8 x 1.5 m, 20 m ahead, coming nearer."""
    box = Box3D(upright(-2.5, 0.9, 22.0, 0.3), 4.0, 1.8, 1.5, SIGMA)
    followed = Track(
        7,
        box,
        np.array([0.5, 0.0, -8.25]),
        np.array([0.2, 0.1, 0.6]),
        "Car",
        over_ground=True,
        age_s=1.5,
        seen=15,
        speed_m_s=8.27,
        sigma_speed_m_s=0.6,
        contact=Contact(2.4, 0.2, -3.1, -1.0, 0.25),
    )
    return Obstacle(
        Detection("Car", (520.25, 170.0, 640.5, 260.0), 0.875),
        20.0,
        0.35,
        box,
        0.08,
        confidence=0.8,
        occluded=True,
        pixels=np.array([3, 4, 5], np.int64),
        track=followed if track else None,
    )


def light() -> Obstacle:
    """Of two words, and not tracked."""
    box = Box3D(upright(3.0, -2.0, 41.0, -1.0), 0.3, 0.3, 0.9, SIGMA)
    detection = Detection("traffic light", (770.0, 90.0, 785.0, 130.0), 0.5)
    pixels = np.array([0, 1], np.int64)
    return Obstacle(detection, 40.8, 1.2, box, 1.0, "size", truncated=True, pixels=pixels)
