"""Rendered worlds seen through lenses: pictures as cameras take them, with exact truth."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import cv2
import numpy as np

from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import Rectification
from pseudolidar.sources.worlds import shading
from pseudolidar.sources.worlds.photometry import Photometry
from pseudolidar.sources.worlds.render import EDGE_SAMPLES_PX, render
from pseudolidar.sources.worlds.room import Room
from pseudolidar.sources.worlds.scene import Scene, scene_at
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.frame import RawPair
from pseudolidar.structures.pose import Pose
from tests.raw_rigs import FISHEYE, PINHOLE

WORLD = Room(seed=3)
BASELINE_M = 0.12


def world_rig(
    lens: Literal["pinhole", "fisheye"], size_px: tuple[int, int] = (480, 360), *, focal_px: float
) -> StereoRig:
    """Two cameras 12 cm apart that look a degree or two apart."""
    width, height = size_px
    K = np.array([[focal_px, 0, width / 2 - 6], [0, 1.01 * focal_px, height / 2 + 4], [0, 0, 1]])
    K_right = K + np.array([[3.0, 0, 5], [0, 2, -7], [0, 0, 0]])
    D = PINHOLE[:12] if lens == "pinhole" else FISHEYE
    R = cv2.Rodrigues(np.array([0.015, 0.03, -0.012]))[0]
    place_m = np.array([-BASELINE_M, 0.002, 0.004])
    return StereoRig(
        Camera(K, width, height, D, lens),
        Camera(K_right, width, height, 0.9 * D, lens, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", R, place_m),
    )


def T_world_left(t_s: float, pitch_deg: float = 0.0) -> np.ndarray:
    """(4, 4) pose of the left camera in the world at a time."""
    down = np.deg2rad(pitch_deg)
    tilt = np.eye(4)
    tilt[:3, :3] = cv2.Rodrigues(np.array([-down, 0, 0]))[0]
    T_base_left = np.linalg.inv(WORLD.design.T_left_velodyne.matrix)
    return WORLD.T_world_base(t_s) @ T_base_left @ tilt


def raw_pair(rig: StereoRig, t_s: float = 0.0, *, name: str = "000000", index: int = 0) -> RawPair:
    """The pair that such cameras would take."""
    scene, T_left = scene_at(WORLD, t_s), T_world_left(t_s)
    T_right = T_left @ rig.T_right_left.inverse().matrix
    sensor = Photometry()
    left, right = (
        sensor.expose(
            _light(scene, camera, T), right=eye == 1, rng=np.random.default_rng([index, eye])
        )
        for eye, (camera, T) in enumerate(((rig.left, T_left), (rig.right, T_right)))
    )
    return RawPair(left, right, rig, name, index, 1_000_000_000 + index * 100_000_000)


def true_depth(planned: Rectification, t_s: float = 0.0) -> np.ndarray:
    """(H, W) exact depth Z of the rectified left picture, by rays of its own."""
    T = T_world_left(t_s) @ _turned(planned.R_left)
    return render(scene_at(WORLD, t_s), planned.rig.left, T).depth


def true_ranges(directions: np.ndarray, T_world_camera: np.ndarray, t_s: float = 0.0) -> np.ndarray:
    """(N,) distance of what lies in directions (N, 3) of a camera; NaN for nothing."""
    scene = scene_at(WORLD, t_s)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return _shaded(scene, T_world_camera, unit, 1e-3)[0]


def _turned(R: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = R.T
    return T


def _light(scene: Scene, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
    """(H, W, 3) linear light, four rays a pixel; black where the lens shows nothing."""
    width, height = camera.size_px
    light = np.zeros((height * width, 3), np.float32)
    for directions in _rays(camera):
        seen = np.isfinite(directions[:, 0])
        light[seen] += _shaded(scene, T_world_camera, directions[seen], 0.7 / camera.focal_px)[1]
    return (light / len(EDGE_SAMPLES_PX)).reshape(height, width, 3)


@lru_cache(maxsize=2)  # of both eyes: their pictures are taken again and again
def _rays(camera: Camera) -> list[np.ndarray]:
    """(H * W, 3) directions of the rays of every pixel, for each of its rays."""
    lens = Lens.of(camera)
    width, height = camera.size_px
    v, u = np.indices((height, width), np.float64)
    return [
        lens.directions(np.stack([u + du, v + dv], -1)).reshape(-1, 3) for du, dv in EDGE_SAMPLES_PX
    ]


def _shaded(
    scene: Scene, T_world_camera: np.ndarray, directions: np.ndarray, footprint: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N,) and light (N, 3) along unit directions (N, 3) of a camera."""
    R = T_world_camera[:3, :3]
    eye = T_world_camera[:3, 3] - scene.origin_m
    rays = np.ascontiguousarray(directions @ R.T)
    prims = scene.hit(eye, rays)
    fixed, moving = scene.fixed, scene.moving
    depth, points, colour, normals, facing = shading.shade(
        eye, rays, footprint * R[:, 0], footprint * R[:, 1], prims,
        fixed.rows, fixed.kind, moving.rows, moving.kind, scene.light.sky_seed,
    )  # fmt: skip
    light = scene.light_row()
    shadows, which = shading.shadow_rays(points, facing, depth, light)
    lit = np.zeros(len(depth), bool)
    lit[which] = ~scene.shadowed(shadows)
    shading.light_of(colour, normals, rays, depth, lit, points, light)
    return depth, colour
