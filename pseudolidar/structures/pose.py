"""Rigid transforms between named frames, and trajectories of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import AnyArray, Bool, Float64, Int64, check_array

# A rotation read from a text file with 6-7 digits is orthonormal to about 1e-6; beyond 1e-3 it is
# none.
ROTATION_TOLERANCE = 1e-3
# Products of larger ones overflow.
LARGEST_ELEMENT = 1e50

AnyPoints = TypeVar("AnyPoints", bound=AnyArray)


@dataclass(frozen=True, eq=False)
class Pose:
    """`T_dst_src`: maps points of frame `src` to frame `dst`, `p_dst = T_dst_src @ p_src`.

    Args:
        dst: name of the frame that points are mapped to.
        src: name of the frame that points come from.
        matrix: (4, 4) float64, rigid, translation in metres.
    """

    dst: str
    src: str
    matrix: Float64

    def __post_init__(self) -> None:
        check_array("Pose", "matrix", self.matrix, (4, 4), np.float64)
        error = rotation_error(self.matrix[:3, :3])
        if not error <= ROTATION_TOLERANCE or not np.array_equal(self.matrix[3], (0, 0, 0, 1)):
            raise StructureError(
                f"T_{self.dst}_{self.src} is not rigid (orthonormality error {error:.2g})",
                want=f"a rotation to {ROTATION_TOLERANCE:g} and last row 0 0 0 1",
                where="Pose.matrix",
            )

    @classmethod
    def identity(cls, dst: str, src: str) -> Self:
        """Frames `dst` and `src` coincide."""
        return cls(dst, src, np.eye(4))

    @classmethod
    def from_rotation(cls, dst: str, src: str, R: Float64, t_m: Float64) -> Self:
        """Pose from a (3, 3) rotation and a (3,) translation in metres."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = R, t_m
        return cls(dst, src, matrix)

    def __matmul__(self, other: Pose) -> Pose:
        """Chain: `T_a_b @ T_b_c = T_a_c`; frames are checked."""
        if self.src != other.dst:
            raise StructureError(
                f"T_{self.dst}_{self.src} @ T_{other.dst}_{other.src}",
                want=f"the second pose to map into {self.src!r}",
                where="Pose",
            )
        return Pose(self.dst, other.src, self.matrix @ other.matrix)

    def inverse(self) -> Pose:
        """`T_src_dst`."""
        R, t = self.matrix[:3, :3], self.matrix[:3, 3]
        return Pose.from_rotation(self.src, self.dst, R.T, -R.T @ t)

    def apply(self, points: AnyPoints) -> AnyPoints:
        """Map (N, 3) points of `src` to `dst`, keeping their dtype.

        Column by column instead of by a matrix product: BLAS would use all cores for one frame
        while others wait, and may round differently by their number.
        """
        R, t_m = self.matrix[:3, :3].astype(points.dtype), self.matrix[:3, 3].astype(points.dtype)
        mapped = np.empty_like(points)
        x, y, z = np.ascontiguousarray(points.T)
        for row in range(3):
            column = x * R[row, 0]
            column += y * R[row, 1]
            column += z * R[row, 2]
            column += t_m[row]
            mapped[:, row] = column
        return mapped

    @property
    def translation_m(self) -> Float64:
        """(3,) origin of `src` in `dst`, metres."""
        return self.matrix[:3, 3].copy()


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a body over time.

    Args:
        timestamps_ns: (N,) int64, strictly increasing.
        T_world_body: (N, 4, 4) float64, metres.
        covariance: (N, 6, 6) float64 of twists on the right of the poses, as `OdometryState` has
            it; None where nobody knows.
        extrapolated: (N,) bool of poses that nothing was measured of, between others that are
            measured; None where all are.
    """

    timestamps_ns: Int64
    T_world_body: Float64
    covariance: Float64 | None = None
    extrapolated: Bool | None = None

    def __post_init__(self) -> None:
        check_array("Trajectory", "timestamps_ns", self.timestamps_ns, (None,), np.int64)
        n = len(self.timestamps_ns)
        check_array("Trajectory", "T_world_body", self.T_world_body, (n, 4, 4), np.float64)
        if self.covariance is not None:
            check_array("Trajectory", "covariance", self.covariance, (n, 6, 6), np.float64)
        if self.extrapolated is not None:
            check_array("Trajectory", "extrapolated", self.extrapolated, (n,), np.bool_)
        if np.any(np.diff(self.timestamps_ns) <= 0):
            raise StructureError(
                "time stamps that do not increase", where="Trajectory.timestamps_ns"
            )

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    @property
    def doubts(self) -> Float64:
        """(N, 6, 6) `covariance`.

        Raises:
            StructureError: nobody knows it.
        """
        if self.covariance is None:
            raise StructureError("poses without covariance", where="Trajectory")
        return self.covariance


def rotation_error(R: Float64) -> float:
    """Largest deviation of `R` (3, 3) from a rotation: of `R R^T` from I, of det from 1.

    Infinite where an element is so far from any of a rotation, or none, that it means nothing.
    """
    if not (np.abs(R) <= LARGEST_ELEMENT).all():
        return float("inf")
    orthonormality = np.abs(R @ R.T - np.eye(3)).max()
    return float(max(orthonormality, abs(_determinant(R) - 1.0)))


def rotation_fault(R: Float64) -> str:
    """How far a matrix (3, 3) is from a rotation, in words."""
    error = rotation_error(R)
    if not error < LARGEST_ELEMENT:
        return "numbers beyond any of a rotation"
    return f"off by {error:.2g}, determinant {_determinant(R):.4g}"


def _determinant(R: Float64) -> float:
    with np.errstate(all="ignore"):  # of products that are too small for a number
        return float(np.linalg.det(R))
