"""Boards as cameras see them: corners by projection, and pictures by tracing every pixel's ray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.boards.board import Board, BoardName
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.shapes import raster, shapes_of
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

RASTER_PX_PER_M = 4000.0
GROUND, BLACK, WHITE = 90, 30, 225


def board(name: str, square_m: float = 0.03, **sizes) -> Board:
    return Board.of(BoardName.parse(name), square_m, **sizes)


def pinhole_rig(*, right_scale: float = 1.0, baseline_m: float = 0.12) -> StereoRig:
    """Eyes that are turned against each other a little; the right one may be of another size."""
    left = Camera(
        np.array([[520.0, 0, 318], [0, 522, 243], [0, 0, 1]]),
        640,
        480,
        np.array([-0.12, 0.06, 0.0008, -0.0006, -0.01]),
    )
    s = right_scale
    right = Camera(
        np.array([[515.0 * s, 0, 326 * s], [0, 516 * s, 236 * s], [0, 0, 1]]),
        round(640 * s),
        round(480 * s),
        np.array([-0.10, 0.05, -0.0005, 0.0004, -0.01]),
        frame="camera_right",
    )
    T = exp_twist(np.array([-baseline_m, 0.001, 0.002, 0.01, -0.02, 0.008]))
    return StereoRig(left, right, Pose("camera_right", "camera_left", T))


def fisheye_rig() -> StereoRig:
    left = Camera(
        np.array([[230.0, 0, 402], [0, 231, 305], [0, 0, 1]]),
        800,
        600,
        np.array([0.02, -0.01, 0.004, -0.001]),
        "fisheye",
    )
    right = Camera(
        np.array([[228.0, 0, 396], [0, 228, 297], [0, 0, 1]]),
        800,
        600,
        np.array([0.015, -0.008, 0.003, -0.001]),
        "fisheye",
        "camera_right",
    )
    T = exp_twist(np.array([-0.11, 0.001, 0.0, 0.004, 0.01, -0.006]))
    return StereoRig(left, right, Pose("camera_right", "camera_left", T))


def poses(
    board: Board, count: int, *, seed: int = 0, near: float = 1.6, spread: float = 0.9
) -> list[np.ndarray]:
    """`T_left_board` of a board held in many ways; `near` in widths of the board."""
    rng = np.random.default_rng(seed)
    points = board.points_m
    size_m = float(np.ptp(points[:, 0]))
    middle = np.eye(4)
    middle[:3, 3] = -points.mean(axis=0)
    found = []
    for _ in range(count):
        turn = np.concatenate([rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.3, 0.3, 1)])
        z = rng.uniform(near, near * 1.7) * size_m
        shift = np.array([rng.uniform(-0.3, 0.3) * z * spread, rng.uniform(-0.2, 0.2) * z, z])
        placed = exp_twist(np.concatenate([np.zeros(3), turn]))
        placed[:3, 3] = shift
        found.append(placed @ middle)
    return found


@dataclass(frozen=True)
class Seeing:
    """How corners are seen."""

    noise_px: float = 0.1
    seed: int = 1


def seen_by(
    rig: StereoRig, board: Board, T_left_board: np.ndarray, seeing: Seeing = Seeing()
) -> tuple[Corners, Corners]:
    """The corners that are inside of both pictures, with noise."""
    rng = np.random.default_rng(seeing.seed)
    found = []
    for camera, T in ((rig.left, np.eye(4)), (rig.right, rig.T_right_left.matrix)):
        points = board.points_m @ (T @ T_left_board)[:3, :3].T + (T @ T_left_board)[:3, 3]
        uv, holds = Lens.of(camera).pixels(points)
        uv = uv + rng.normal(scale=seeing.noise_px, size=uv.shape)
        inside = holds & Lens.of(camera).inside(uv)
        found.append(Corners(np.flatnonzero(inside), uv[inside]))
    return found[0], found[1]


def picture(
    camera: Camera,
    board: Board,
    T_camera_board: np.ndarray,
    *,
    noise: float = 2.0,
    seed: int = 0,
    samples: int = 2,
) -> np.ndarray:
    """(H, W) what a camera sees of a board: rays of every pixel, `samples`^2 each."""
    import cv2

    drawing = shapes_of(board)
    margin_m = board.square_m * 0.8
    flat = np.pad(raster(drawing, RASTER_PX_PER_M), round(margin_m * RASTER_PX_PER_M),
                  constant_values=255)  # fmt: skip
    flat = (BLACK + flat.astype(np.float32) / 255 * (WHITE - BLACK)).astype(np.float32)
    # Blurred as far as a pixel of the camera spans, so that it is not sampled too thinly.
    span = RASTER_PX_PER_M * T_camera_board[2, 3] / camera.K[0, 0] / samples
    flat = cv2.GaussianBlur(flat, (0, 0), max(span * 0.5, 0.3))
    low = drawing.low_m - margin_m
    step = (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros((camera.height_px, camera.width_px))
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px].astype(np.float64)
    R, t = T_camera_board[:3, :3], T_camera_board[:3, 3]
    for dx in step:
        for dy in step:
            rays = _rays(camera, np.stack([u + dx, v + dy], axis=-1))
            with np.errstate(all="ignore"):
                depth = (R[:, 2] @ t) / (rays @ R[:, 2])
                on_board = (rays * depth[..., None] - t) @ R
            at = (on_board[..., :2] - low) * RASTER_PX_PER_M - 0.5
            at[~(depth > 0)] = -1e4
            at = np.nan_to_num(at, nan=-1e4).clip(-1e4, 3e4).astype(np.float32)
            total += cv2.remap(flat, at[..., 0], at[..., 1], cv2.INTER_LINEAR,
                               borderMode=cv2.BORDER_CONSTANT, borderValue=GROUND)  # fmt: skip
    total /= samples**2
    total += np.random.default_rng(seed).normal(scale=noise, size=total.shape)
    return np.clip(np.round(total), 0, 255).astype(np.uint8)


def _rays(camera: Camera, uv: np.ndarray) -> np.ndarray:
    """(..., 3) directions of pixels; of pinholes by OpenCV, which is faster and another's code."""
    import cv2

    if camera.model == "fisheye":
        return Lens.of(camera).directions(uv)
    stop = (cv2.TERM_CRITERIA_COUNT, 20, 0.0)
    flat = cv2.undistortPoints(
        uv.reshape(-1, 1, 2), camera.K, camera.distortion, None, None, None, stop
    )
    return np.concatenate([flat.reshape(uv.shape), np.ones((*uv.shape[:-1], 1))], axis=-1)
