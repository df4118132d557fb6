"""Sights of flat things before a wall, each a rectangle of the picture at one depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.geometry.planes import Plane
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.pose import Pose

WIDTH, HEIGHT, FOCAL_PX, BASELINE_M = 640, 240, 400.0, 0.5
CAMERA = Camera(np.array([[FOCAL_PX, 0, 319.5], [0, FOCAL_PX, 99.5], [0, 0, 1.0]]), WIDTH, HEIGHT)
RIG = StereoRig(
    CAMERA,
    replace(CAMERA, frame="camera_right"),
    Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-BASELINE_M, 0, 0])),
)
EYE_HEIGHT_M, WALL_M, SIGMA_PX = 1.6, 60.0, 0.25

Thing = tuple[str, float, float, float, float]  # class, x of its middle, z, width, height: m


def box_px(thing: Thing) -> tuple[float, float, float, float]:
    _, x, z, width, height = thing
    bottom = FOCAL_PX * EYE_HEIGHT_M / z + 99.5
    left, right = (FOCAL_PX * (x + side * width / 2) / z + 319.5 for side in (-1, 1))
    return left, bottom - FOCAL_PX * height / z, right, bottom


def detection(thing: Thing) -> Detection:
    return Detection(thing[0], box_px(thing))


def sight(things: Sequence[Thing], *, ground: bool = True, seed: int = 0) -> Sight:
    rows = np.arange(HEIGHT)[:, None] + np.zeros((1, WIDTH))
    with np.errstate(divide="ignore"):
        floor = FOCAL_PX * EYE_HEIGHT_M / np.maximum(rows - 99.5, 1e-9)
    depth = np.minimum(floor, WALL_M)
    is_ground = depth < WALL_M
    for thing in sorted(things, key=lambda one: -one[2]):
        left, top, right, bottom = (round(edge) for edge in box_px(thing))
        window = np.s_[max(0, top) : bottom + 1, max(0, left) : right + 1]
        depth[window], is_ground[window] = thing[2], False
    rng = np.random.default_rng(seed)
    sigma = SIGMA_PX * depth**2 / (FOCAL_PX * BASELINE_M)
    depth = depth + 0.3 * sigma * rng.standard_normal(depth.shape)
    return Sight(
        "frame",
        np.zeros((HEIGHT, WIDTH), np.uint8),
        CAMERA,
        DepthMap(depth.astype(np.float32), sigma.astype(np.float32)),
        rig=RIG,
        ground=Plane("camera_left", np.array([0.0, -1.0, 0.0]), EYE_HEIGHT_M) if ground else None,
        is_ground=is_ground if ground else None,
        shared_px=0.15,
    )
