"""Rigs of unrectified cameras, with what is seen where computed without the code under test."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np

from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

# By number of coefficients; of a cheap wide lens, in OpenCV's order.
PINHOLE = np.array(
    [-0.3, 0.1, 0.001, -0.002, 0.01, 0.1, 0.02, 0.001, 0.002, -0.001, 0.003, 0.001, 0.03, -0.02]
)
FISHEYE = np.array([0.05, -0.02, 0.003, -0.0005])
TURN, PLACE_M = np.array([0.02, -0.03, 0.01]), np.array([-0.2, 0.004, 0.01])


def raw_rig(
    coefficients: int = 5,
    *,
    model: Literal["pinhole", "fisheye"] = "pinhole",
    right_px: tuple[int, int] = (640, 480),
    focal_px: float | None = None,
    turn: np.ndarray = TURN,
    place_m: np.ndarray = PLACE_M,
    strength: float = 1.0,
) -> StereoRig:
    """Two cameras that look a little apart; the right one of any size, its focal length with it."""
    focal = focal_px or (500.0 if model == "pinhole" else 225.0)
    D = strength * (PINHOLE[:coefficients] if model == "pinhole" else FISHEYE)
    ratio = right_px[0] / 640
    K = np.array([[focal, 0, 325.0], [0, 1.02 * focal, 236.0], [0, 0, 1]])
    K_right = np.array([[1.01 * focal, 0, 315.0], [0, 1.004 * focal, 244.0], [0, 0, 1]])
    K_right[:2] *= ratio
    R = cv2.Rodrigues(turn)[0]
    return StereoRig(
        Camera(K, 640, 480, D, model),
        Camera(K_right, *right_px, 0.9 * D, model, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", R, R @ place_m),
    )


def seen_at(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of points (N, 3) in the camera's frame, by OpenCV."""
    zero = np.zeros(3)
    if camera.model == "fisheye":
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, camera.K, camera.distortion)[
            0
        ][:, 0]
    D = camera.distortion if len(camera.distortion) else None
    return cv2.projectPoints(points, zero, zero, camera.K, D)[0][:, 0]
