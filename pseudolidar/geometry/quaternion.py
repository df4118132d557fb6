"""Rotations as unit quaternions, wxyz."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64

# Below this arc, rad, the chord is the arc to float64's last digits.
SMALLEST_ARC = 1e-8


def quaternion_wxyz(R: Float64) -> Float64:
    """Unit quaternion of a rotation.

    Args:
        R: (3, 3) rotation.

    Returns:
        (4,) w, x, y, z with w >= 0 and norm 1.

    Source: Shepperd, Quaternion from rotation matrix, 1978: dividing by the largest component
        keeps all digits at every angle.
    """
    trace = float(np.trace(R))
    squares = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    largest = int(squares.argmax())
    q = np.empty(4)
    if largest == 0:
        q[:] = 1 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0] = R[k, j] - R[j, k]
        q[1 + i] = 1 + 2 * R[i, i] - trace
        q[1 + j] = R[j, i] + R[i, j]
        q[1 + k] = R[k, i] + R[i, k]
    q /= np.linalg.norm(q)
    return np.asarray(-q if q[0] < 0 else q)


def rotation_of(q_wxyz: Float64) -> Float64:
    """(3, 3) rotation of a quaternion (4,) w, x, y, z of any length but 0."""
    return np.asarray(rotations_of(q_wxyz[None])[0])


def rotations_of(q_wxyz: Float64) -> Float64:
    """(N, 3, 3) rotations of quaternions (N, 4) w, x, y, z of any length but 0."""
    w, x, y, z = (q_wxyz / np.linalg.norm(q_wxyz, axis=1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), -1, 0)


def slerp(a: Float64, b: Float64, share: float) -> Float64:
    """Unit quaternion at `share` (0-1) of the shortest arc from `a` to `b`, each (4,) unit.

    Source: Shoemake, Animating rotation with quaternion curves, 1985.
    """
    cosine = float(a @ b)
    b, cosine = (-b, -cosine) if cosine < 0 else (b, cosine)
    angle = np.arccos(min(cosine, 1.0))
    if angle < SMALLEST_ARC:
        mixed = a * (1 - share) + b * share
    else:
        mixed = (a * np.sin((1 - share) * angle) + b * np.sin(share * angle)) / np.sin(angle)
    return np.asarray(mixed / np.linalg.norm(mixed))
