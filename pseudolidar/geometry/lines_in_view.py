"""Lines in space as a camera sees them: what is behind it is cut off."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float32, Float64

# Lines are cut where they come nearer than this to the image plane, m.
NEAREST_M = 0.2


def in_front(lines_m: Float32 | Float64) -> Float64:
    """(M, 2, 3) what of lines is in front of a camera; those wholly behind it are left out.

    Args:
        lines_m: (N, 2, 3) in the camera's frame, z forward.
    """
    lines = np.asarray(lines_m, np.float64)
    lines = lines[(lines[:, :, 2] > NEAREST_M).any(axis=1)]
    begin, end = lines[:, 0], lines[:, 1]
    step_m = end[:, 2] - begin[:, 2]
    share = (NEAREST_M - begin[:, 2]) / np.where(step_m == 0, 1.0, step_m)
    cut = begin + share[:, None] * (end - begin)
    behind = lines[:, :, 2] < NEAREST_M
    return np.where(behind[:, :, None], cut[:, None], lines)


def lines_px(lines_m: Float32 | Float64, P: Float64) -> Float64:
    """(M, 2, 2) pixels of both ends of what of lines is in front of a camera.

    Args:
        lines_m: (N, 2, 3) in the frame of the left camera.
        P: (3, 4) projection of it, or of the right one of a rectified pair.
    """
    seen = in_front(lines_m) @ P[:, :3].T + P[:, 3]
    return np.asarray(seen[:, :, :2] / seen[:, :, 2:])
