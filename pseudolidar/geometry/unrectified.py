"""Why the pictures of a rig are not those of a rectified pair, in words."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import (
    RECTIFIED_OFF_AXIS,
    RECTIFIED_ROWS_PX,
    RECTIFIED_TOLERANCE,
    StereoRig,
)


def why_unrectified(rig: StereoRig) -> tuple[str, ...]:
    """What keeps rows of the two pictures from corresponding; nothing of a rectified rig.

    Args:
        rig: any.
    """
    left, right = rig.left, rig.right
    reasons: list[str] = []
    if left.size_px != right.size_px:
        sizes = " and ".join(f"{width}x{height}" for width, height in (left.size_px, right.size_px))
        reasons.append(f"pictures of {sizes}")
    if left.distortion.any() or right.distortion.any() or "fisheye" in (left.model, right.model):
        models = dict.fromkeys((left.model, right.model))
        reasons.append(f"distortion of {' and '.join(models)} lenses")
    return (*reasons, *_of_matrices(left.K, right.K), *_of_pose(rig.T_right_left.matrix))


def _of_matrices(K: Float64, K_right: Float64) -> list[str]:
    reasons = [
        f"{name} {K[i, i]:.6g} px left and {K_right[i, i]:.6g} px right"
        for i, name in enumerate(("fx", "fy"))
        if abs(K[i, i] / K_right[i, i] - 1) >= RECTIFIED_TOLERANCE
    ]
    if abs(K[1, 2] - K_right[1, 2]) >= RECTIFIED_ROWS_PX:
        reasons.append(f"cy {K[1, 2]:.6g} px left and {K_right[1, 2]:.6g} px right")
    if K[0, 1] != 0 or K_right[0, 1] != 0:
        reasons.append(f"skew of {K[0, 1]:.3g} and {K_right[0, 1]:.3g} px")
    return reasons


def _of_pose(T_right_left: Float64) -> list[str]:
    reasons: list[str] = []
    R, t_m = T_right_left[:3, :3], T_right_left[:3, 3]
    if np.abs(R - np.eye(3)).max() >= RECTIFIED_TOLERANCE:
        reasons.append(f"a rotation of {rotation_deg(R):.3g} degrees between the cameras")
    # Where the right camera stands; along its own axes where both look the same way.
    x_m, y_m, z_m = -R.T @ t_m
    for axis, off_m in ((1, y_m), (2, z_m)):
        if abs(off_m) > RECTIFIED_OFF_AXIS * abs(x_m):
            reasons.append(f"the right camera {abs(off_m):.3g} m {side_word(axis, off_m)} the left")
    return reasons


def side_word(axis: int, off: float) -> str:
    """On which side of the left camera the right one stands, in the left one's frame.

    Args:
        axis: 1 for y (down), 2 for z (forward).
        off: where it stands on it; only the sign counts.
    """
    before, behind = {1: ("above", "below"), 2: ("behind", "in front of")}[axis]
    return behind if off > 0 else before


def rotation_deg(R: Float64) -> float:
    """Angle of a rotation (3, 3), degrees."""
    # The sine of small angles and the cosine of large ones; arccos alone has 1e-8 at best.
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.degrees(np.arctan2(np.linalg.norm(axis), np.trace(R) - 1)))
