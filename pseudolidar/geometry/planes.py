"""Planes in a named frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import AnyArray, Float64, check_array
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class Plane:
    """All points p of a frame with `normal . p + offset_m = 0`.

    Args:
        frame: coordinate frame.
        normal: (3,) float64 of length 1, to the side that counts as above.
        offset_m: height of the frame's origin above the plane.
    """

    frame: str
    normal: Float64
    offset_m: float

    def __post_init__(self) -> None:
        check_array("Plane", "normal", self.normal, (3,), np.float64)
        length = float(np.linalg.norm(self.normal))
        if not abs(length - 1) < 1e-6:
            raise StructureError(f"length {length:g}", want="1", where="Plane.normal")

    @classmethod
    def of(cls, frame: str, normal: Float64, offset_m: float) -> Plane:
        """The plane of an equation of any length."""
        length = float(np.linalg.norm(normal))
        return cls(frame, np.asarray(normal / length, np.float64), float(offset_m / length))

    def heights_m(self, xyz: AnyArray) -> AnyArray:
        """(N,) signed distances of points (N, 3) of the frame, positive above; NaN stays NaN."""
        a, b, c = self.normal.astype(xyz.dtype)
        heights = a * xyz[:, 0]
        heights += b * xyz[:, 1]
        heights += c * xyz[:, 2]
        heights += xyz.dtype.type(self.offset_m)
        return np.asarray(heights)

    def transformed(self, T_dst_frame: Pose) -> Plane:
        """The same plane in frame `T_dst_frame.dst`.

        Raises:
            StructureError: the pose maps another frame.
        """
        if T_dst_frame.src != self.frame:
            raise StructureError(
                f"a plane in {self.frame!r}", want=f"one in {T_dst_frame.src!r}", where="Plane"
            )
        normal = T_dst_frame.matrix[:3, :3] @ self.normal
        offset_m = self.offset_m - float(normal @ T_dst_frame.matrix[:3, 3])
        return Plane.of(T_dst_frame.dst, normal, offset_m)

    def tilt_deg(self, up: Float64) -> float:
        """Angle between the normal and `up` (3,), degrees."""
        cosine = float(self.normal @ up / np.linalg.norm(up))
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
