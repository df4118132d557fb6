"""Lens models with their derivatives, for solvers; parameters of a camera as one vector.

The vector is fx, fy, cx, cy and then OpenCV's coefficients in OpenCV's order. Points without
derivatives, and pixels back to directions, are `geometry/lens.py`'s.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, LensModel

Model = Literal["pinhole", "pinhole8", "thin-prism", "fisheye"]
# Coefficients of each model: k1 k2 p1 p2 k3 | k4 k5 k6 | s1 s2 s3 s4; Kannala and Brandt's k1-k4.
COEFFICIENTS: dict[Model, int] = {"pinhole": 5, "pinhole8": 8, "thin-prism": 12, "fisheye": 4}
INTRINSICS = 4
# Below this distance from the axis, in units of depth, the fisheye is that of its centre.
ON_AXIS = 1e-9


def parameters(model: Model) -> int:
    """Length of a camera's vector."""
    return INTRINSICS + COEFFICIENTS[model]


def camera_of(model: Model, vector: Float64, size_px: tuple[int, int], frame: str) -> Camera:
    """The camera of a vector.

    Args:
        model: of the lens.
        vector: (n,) fx, fy, cx, cy, px, and the coefficients.
        size_px: (width, height) of its pictures.
        frame: name of its frame.

    Raises:
        CalibrationValue: no camera can have these numbers.
    """
    fx, fy, cx, cy = vector[:INTRINSICS]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    lens: LensModel = "fisheye" if model == "fisheye" else "pinhole"
    return Camera(K, *size_px, vector[INTRINSICS:].copy(), lens, frame)


def project(model: Model, vector: Float64, points: Float64) -> tuple[Float64, Float64, Float64]:
    """Pixels of points and how they change.

    Args:
        model: of the lens.
        vector: (n,) the camera's parameters.
        points: (..., 3) in the camera's frame, m.

    Returns:
        (..., 2) pixels, (..., 2, 3) their derivative by the point, (..., 2, n) by the parameters.

    Source: OpenCV, modules calib and fisheye, "Detailed description".
    """
    flat = _fisheye if model == "fisheye" else _pinhole
    bent, by_point, by_coefficients = flat(vector[INTRINSICS:], points)
    focal = vector[:2]
    uv = bent * focal + vector[2:INTRINSICS]
    by_vector = np.zeros((*points.shape[:-1], 2, len(vector)))
    by_vector[..., 0, 0], by_vector[..., 1, 1] = bent[..., 0], bent[..., 1]
    by_vector[..., 0, 2] = by_vector[..., 1, 3] = 1.0
    by_vector[..., INTRINSICS:] = by_coefficients * focal[:, None]
    return uv, by_point * focal[:, None], by_vector


def _fisheye(k: Float64, points: Float64) -> tuple[Float64, Float64, Float64]:
    """(..., 2) bent plane coordinates, their derivatives by the point and by k1-k4."""
    X, Y, Z = np.moveaxis(points, -1, 0)
    side = np.maximum(np.hypot(X, Y), ON_AXIS * np.abs(Z) + np.finfo(float).tiny)
    length2 = side * side + Z * Z
    angle = np.arctan2(side, Z)
    a2 = angle * angle
    powers = np.stack([a2 ** (n + 1) for n in range(4)], axis=-1)
    bent_angle = angle * (1 + powers @ k)
    slope = 1 + powers @ (k * np.array([3.0, 5.0, 7.0, 9.0]))
    scale = bent_angle / side
    # d(scale) along the side and along Z.
    by_side = (slope * Z / length2 - scale) / side
    by_depth = -slope / length2
    xy = np.stack([X, Y], axis=-1)
    unit = xy / side[..., None]
    by_point = np.zeros((*points.shape[:-1], 2, 3))
    by_point[..., :, :2] = xy[..., :, None] * unit[..., None, :] * by_side[..., None, None]
    by_point[..., 0, 0] += scale
    by_point[..., 1, 1] += scale
    by_point[..., :, 2] = xy * by_depth[..., None]
    by_k = unit[..., :, None] * (angle[..., None] * powers)[..., None, :]
    return xy * scale[..., None], by_point, by_k


def _pinhole(k: Float64, points: Float64) -> tuple[Float64, Float64, Float64]:
    """(..., 2) bent plane coordinates, their derivatives by the point and by the coefficients."""
    Z = points[..., 2]
    x, y = points[..., 0] / Z, points[..., 1] / Z
    full = np.zeros(12)
    full[: len(k)] = k
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = full
    r2, xy2 = x * x + y * y, 2 * x * y
    r4, r6 = r2 * r2, r2**3
    above, below = 1 + k1 * r2 + k2 * r4 + k3 * r6, 1 + k4 * r2 + k5 * r4 + k6 * r6
    ratio = above / below
    across_x, across_y = r2 + 2 * x * x, r2 + 2 * y * y
    bent = np.stack(
        [
            x * ratio + p1 * xy2 + p2 * across_x + s1 * r2 + s2 * r4,
            y * ratio + p1 * across_y + p2 * xy2 + s3 * r2 + s4 * r4,
        ],
        axis=-1,
    )
    by_r2 = (k1 + 2 * k2 * r2 + 3 * k3 * r4 - ratio * (k4 + 2 * k5 * r2 + 3 * k6 * r4)) / below
    prism_x, prism_y = s1 + 2 * s2 * r2, s3 + 2 * s4 * r2
    dxx = ratio + 2 * x * x * by_r2 + 2 * p1 * y + 6 * p2 * x + 2 * x * prism_x
    dxy = xy2 * by_r2 + 2 * p1 * x + 2 * p2 * y + 2 * y * prism_x
    dyx = xy2 * by_r2 + 2 * p1 * x + 2 * p2 * y + 2 * x * prism_y
    dyy = ratio + 2 * y * y * by_r2 + 6 * p1 * y + 2 * p2 * x + 2 * y * prism_y
    by_point = np.empty((*points.shape[:-1], 2, 3))
    by_point[..., 0, 0], by_point[..., 0, 1] = dxx / Z, dxy / Z
    by_point[..., 1, 0], by_point[..., 1, 1] = dyx / Z, dyy / Z
    by_point[..., 0, 2] = -(dxx * x + dxy * y) / Z
    by_point[..., 1, 2] = -(dyx * x + dyy * y) / Z
    radial = [r2, r4, r6]
    lower = [-ratio * power for power in radial]
    zero = np.zeros_like(x)
    along = [power / below for power in (*radial, *lower)]
    by_x = [x * a for a in along]
    by_y = [y * a for a in along]
    rows = [
        [by_x[0], by_x[1], xy2, across_x, *by_x[2:], r2, r4, zero, zero],
        [by_y[0], by_y[1], across_y, xy2, *by_y[2:], zero, zero, r2, r4],
    ]
    by_k = np.stack([np.stack(row[: len(k)], axis=-1) for row in rows], axis=-2)
    return bent, by_point, by_k
