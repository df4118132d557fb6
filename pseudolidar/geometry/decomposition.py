"""A projection matrix as camera, rotation and translation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import CalibrationValue
from pseudolidar.structures.arrays import Float64

# A left 3x3 part whose rows, each of length one, span less than this volume is taken for singular:
# it is a camera at infinity, or no camera at all.
LEAST_VOLUME = 1e-12
# Squares of larger numbers overflow.
LARGEST_ELEMENT = 1e150


@dataclass(frozen=True, eq=False)
class Decomposition:
    """What a projection matrix is made of: `P ~ K [R | t]`.

    Args:
        K: (3, 3) float64, upper triangular, focal lengths above 0, last element 1.
        R: (3, 3) rotation, determinant 1: directions of the world to the camera's frame.
        t: (3,) the world's origin in the camera's frame, in the unit of P.
        scale: `P = scale K [R | t]`; below 0 where P has the other sign.
    """

    K: Float64
    R: Float64
    t: Float64
    scale: float

    @property
    def centre(self) -> Float64:
        """(3,) where the camera stands in the world, `-R^T t`."""
        return -self.R.T @ self.t

    @property
    def matrix(self) -> Float64:
        """(4, 4) of the world to the camera's frame."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.R, self.t
        return T


def decompose(P: Float64) -> Decomposition:
    """Take a projection matrix apart; its scale and its sign mean nothing.

    OpenCV's `decomposeProjectionMatrix` leaves K with P's scale and gives the centre in place of
    t; where P has the other sign it gives a mirrored K.

    Args:
        P: (3, 4) float64, points of the world to pixels.

    Returns:
        K with focal lengths above 0, a proper rotation, and t. Of a P that is `K [I | t]` already,
        exactly these.

    Raises:
        CalibrationValue: no finite camera: numbers that are not finite, or a singular left part.

    Source: Hartley & Zisserman, Multiple View Geometry, 2nd ed., section 6.2.4 and A4.1.1.
    """
    _check(P)
    sign = 1.0 if np.linalg.det(P[:, :3]) > 0 else -1.0
    M = sign * P[:, :3]
    K, R = (M, np.eye(3)) if _is_intrinsics(M) else _rq(M)
    scale = float(K[2, 2])
    K = K / scale
    t = np.linalg.solve(K, sign * P[:, 3] / scale)
    return Decomposition(K, R, np.asarray(t, dtype=np.float64), sign * scale)


def _check(P: Float64) -> None:
    usable = bool((np.abs(P) < LARGEST_ELEMENT).all())
    lengths = np.linalg.norm(P[:, :3], axis=1) if usable else np.zeros(3)
    usable = usable and bool((lengths > 0).all())
    volume = abs(np.linalg.det(P[:, :3] / lengths[:, None])) if usable else 0.0
    if not volume > LEAST_VOLUME:
        rows = "; ".join(" ".join(f"{x:.6g}" for x in row) for row in P)
        raise CalibrationValue(
            f"[{rows}] is no camera: the left three columns are singular",
            want="K [R | t] with focal lengths above 0",
        )


def _is_intrinsics(M: Float64) -> bool:
    below = np.array([M[1, 0], M[2, 0], M[2, 1]])
    return bool((below == 0).all() and (np.diag(M) > 0).all())


def _rq(M: Float64) -> tuple[Float64, Float64]:
    """`M = K R`: K upper triangular with a diagonal above 0, R a rotation; det M > 0."""
    Q, U = np.linalg.qr(M[::-1].T)
    K, R = U.T[::-1, ::-1], Q.T[::-1]
    signs = np.sign(np.diag(K))
    return np.asarray(K * signs), np.asarray(R * signs[:, None])
