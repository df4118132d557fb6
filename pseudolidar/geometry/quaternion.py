"""Rotations as unit quaternions, wxyz."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64


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
