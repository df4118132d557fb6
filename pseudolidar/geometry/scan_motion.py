"""Scans of a LiDAR that drove on while it turned: when each point was taken, and where it was."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.twists import skew
from pseudolidar.structures.arrays import AnyArray, Float32, Float64, Int64
from pseudolidar.structures.motion import BodyMotion

# Below this turn, rad, the series of the rotation is exact to double precision.
SMALL_ANGLE_RAD = 1e-6


def turning_times_ns(xyz: AnyArray, turn_ns: tuple[int, int]) -> Int64:
    """(N,) when a spinning LiDAR took its points, told by their azimuth.

    The turn begins straight behind, goes by the left side, and faces forward in the middle:
    clockwise from above, as KITTI's Velodyne does. (Measured on drive 0002: only that direction
    brings the depths at both borders of the image into line with stereo.)

    Args:
        xyz: (N, 3) m in the LiDAR's frame, x forward, y left.
        turn_ns: when it began and ended.
    """
    azimuth = np.arctan2(xyz[:, 1].astype(np.float64), xyz[:, 0].astype(np.float64))
    share = 0.5 - azimuth / (2.0 * np.pi)
    begin_ns, end_ns = turn_ns
    return begin_ns + np.rint(share * (end_ns - begin_ns)).astype(np.int64)


def at_one_moment(xyz: AnyArray, seconds: Float64, motion: BodyMotion) -> Float32:
    """Where a standing world's points are seen from the place that the sensor has at one moment.

    The sensor moves with a constant twist, so that it stood at exp(t twist) when a point of time t
    was taken: p = exp(t twist) p_t.

    Args:
        xyz: (N, 3) m in the sensor's frame as it was when each point was taken.
        seconds: (N,) when that was, after the moment.
        motion: of the sensor, in its own axes.

    Source: Barfoot, State Estimation for Robotics, equations 7.15 and 7.85.
    """
    w, v = motion.rate_rad_s, motion.velocity_m_s
    angle = np.linalg.norm(w) * seconds
    small = np.abs(angle) < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0, np.sin(angle) / safe) * seconds
    second = np.where(small, 0.5, (1.0 - np.cos(angle)) / safe**2) * seconds**2
    third = np.where(small, 1.0 / 6.0, (angle - np.sin(angle)) / safe**3) * seconds**3
    W, p = skew(w), np.ascontiguousarray(xyz.T, np.float64)
    turned, twice = _times(W, p), _times(W @ W, p)
    bent, bent_twice = W @ v, W @ W @ v
    moved = np.empty(xyz.shape, np.float32)
    for axis in range(3):
        way = v[axis] * seconds + bent[axis] * second + bent_twice[axis] * third
        moved[:, axis] = p[axis] + first * turned[axis] + second * twice[axis] + way
    return moved


def _times(matrix: Float64, p: Float64) -> list[Float64]:
    """Rows of matrix @ p, (3, 3) by (3, N); without BLAS, which would use all cores."""
    return [row[0] * p[0] + row[1] * p[1] + row[2] * p[2] for row in matrix]


def raised(xyz: AnyArray, angle_rad: float) -> Float32:
    """Points with a larger elevation, at the same range and azimuth.

    Args:
        xyz: (N, 3) m in the LiDAR's frame, z up.
        angle_rad: added to the elevation of every beam.
    """
    p = xyz.astype(np.float64)
    flat = np.hypot(p[:, 0], p[:, 1])
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    scale = cosine - sine * p[:, 2] / np.where(flat > 0, flat, np.inf)
    height = p[:, 2] * cosine + flat * sine
    return np.column_stack([p[:, 0] * scale, p[:, 1] * scale, height]).astype(np.float32)
