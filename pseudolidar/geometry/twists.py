"""Small rigid motions as six numbers, for solvers that improve a pose step by step."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64

# Below this angle, rad, the series of the exponential is exact to double precision.
SMALL_ANGLE_RAD = 1e-6


def skew(vectors: Float64) -> Float64:
    """(..., 3, 3) matrices `[v]x`, so that `[v]x w = v x w`, of vectors (..., 3)."""
    matrix = np.zeros((*vectors.shape[:-1], 3, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def exp_twists(twists: Float64) -> Float64:
    """(N, 4, 4) rigid motions of twists (N, 6), as `exp_twist` has them."""
    shift, rotation = twists[:, :3], twists[:, 3:]
    angle = np.linalg.norm(rotation, axis=1)
    tiny = angle < SMALL_ANGLE_RAD
    safe = np.where(tiny, 1.0, angle)
    first = np.where(tiny, 1.0, np.sin(safe) / safe)[:, None, None]
    second = np.where(tiny, 0.5, (1.0 - np.cos(safe)) / safe**2)[:, None, None]
    third = np.where(tiny, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)[:, None, None]
    W = skew(rotation)
    WW = W @ W
    motions = np.tile(np.eye(4), (len(twists), 1, 1))
    motions[:, :3, :3] += first * W + second * WW
    motions[:, :3, 3] = ((np.eye(3) + second * W + third * WW) @ shift[..., None])[..., 0]
    return motions


def exp_twist(twist: Float64) -> Float64:
    """(4, 4) rigid motion of a twist (6,): translation part in metres, then rotation vector, rad.

    Source: Barfoot, State Estimation for Robotics, equations 7.15 and 7.85.
    """
    rotation = twist[3:]
    angle = float(np.linalg.norm(rotation))
    W = skew(rotation)
    if angle < SMALL_ANGLE_RAD:
        first, second, third = 1.0, 0.5, 1.0 / 6.0
    else:
        first = np.sin(angle) / angle
        second = (1.0 - np.cos(angle)) / angle**2
        third = (angle - np.sin(angle)) / angle**3
    motion = np.eye(4)
    motion[:3, :3] += first * W + second * (W @ W)
    motion[:3, 3] = (np.eye(3) + second * W + third * (W @ W)) @ twist[:3]
    return motion


def adjoint(T: Float64) -> Float64:
    """(6, 6): `T exp(xi) T^-1 = exp(adjoint(T) xi)` of twists as `exp_twist` has them.

    Source: Barfoot, State Estimation for Robotics, equation 7.45.
    """
    R = T[:3, :3]
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = R
    matrix[:3, 3:] = skew(T[:3, 3]) @ R
    return matrix


def carried(covariance: Float64, T_from_to: Float64) -> Float64:
    """(6, 6) doubt of a pose as it is after a step (4, 4) that is exact.

    Both are of twists on the right of their poses.
    """
    back = adjoint(inverted(T_from_to))
    return np.asarray(back @ covariance @ back.T)


def gone_on(T: Float64, twist_per_s: Float64, seconds: float) -> Float64:
    """(4, 4) a pose later, at one velocity: a twist (6,) by s on its right."""
    return np.asarray(T @ exp_twist(seconds * twist_per_s))


def log_twist(T: Float64) -> Float64:
    """(6,) twist of a rigid motion (4, 4), the inverse of `exp_twist`; angles below pi.

    Source: Barfoot, State Estimation for Robotics, section 7.1.4.
    """
    R, t = T[:3, :3], T[:3, 3]
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = float(np.linalg.norm(axis)), float(np.trace(R) - 1.0) / 2.0
    angle = float(np.arctan2(sine, cosine))
    rotation = axis if angle < SMALL_ANGLE_RAD else axis * angle / sine
    W = skew(rotation)
    if angle < SMALL_ANGLE_RAD:
        third = 1.0 / 12.0
    else:
        half_sine = np.sin(angle / 2.0)
        third = (1.0 - angle * sine / (4.0 * half_sine**2)) / angle**2
    return np.concatenate([(np.eye(3) - 0.5 * W + third * (W @ W)) @ t, rotation])


def inverted(T: Float64) -> Float64:
    """(4, 4) the inverse of a rigid motion, exactly rigid."""
    R, t = T[:3, :3], T[:3, 3]
    inverse = np.eye(4)
    inverse[:3, :3], inverse[:3, 3] = R.T, -R.T @ t
    return inverse


def rigid(T: Float64) -> Float64:
    """(4, 4) the nearest rigid motion of one that rounding has bent.

    Source: Horn, Hilden and Negahdaripour, Closed-form solution of absolute orientation using
        orthonormal matrices, JOSA A 1988: the nearest rotation by singular values.
    """
    left, _, right = np.linalg.svd(T[:3, :3])
    nearest = np.eye(4)
    nearest[:3, :3], nearest[:3, 3] = left @ right, T[:3, 3]
    return nearest
