"""Textured pairs of known disparity."""

from __future__ import annotations

import cv2
import numpy as np

from pseudolidar import Camera, Pose, StereoFrame, StereoRig


def pair(height, width, *, disparity=7.0, seed=0):
    """Textured pair with a slanted background and a nearer square."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (height, width * 2)), (0, 0), 0.8)
    x = np.arange(width, dtype=np.float32)
    y = np.arange(height, dtype=np.float32)
    d = disparity + 0.05 * y[:, None] + 0 * x
    d[height // 4 : height // 2, width // 2 : 3 * width // 4] += 6
    maps = (x + 0 * y[:, None] + d).astype(np.float32), (y[:, None] + 0 * x).astype(np.float32)
    right = cv2.remap(texture.astype(np.float32), *maps, cv2.INTER_CUBIC)
    left = texture[:, :width]
    noise = rng.normal(0, 2, (2, height, width))
    return tuple(
        np.clip(i + n, 0, 255).astype(np.uint8) for i, n in zip((left, right), noise, strict=True)
    )


def frame(left, right, *, focal_px=200.0, baseline_m=0.5):
    height, width = left.shape[:2]
    K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
    eyes = [Camera(K, width, height, frame=f"camera_{side}") for side in ("left", "right")]
    t_m = np.array([-baseline_m, 0, 0])
    T = Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m)
    return StereoFrame(left, right, StereoRig(*eyes, T), id="0", index=0, timestamp_ns=1)
