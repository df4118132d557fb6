"""The point cloud: aligned columns in one checked object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Int64, UInt8, check_array
from pseudolidar.structures.pose import Pose

XYZ = (np.float32, np.float64)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points with their columns; all columns have the same length and order.

    Args:
        xyz: (N, 3) float32 m (float64 for geo-referenced clouds); rows are NaN only in
            organised clouds.
        frame: coordinate frame.
        timestamp_ns: time of the picture or scan.
        rgb: (N, 3) uint8.
        intensity: (N,) float32, 0-1; None where unknown (a pseudo-LiDAR has no reflectance).
        sigma_m: (N,) float32, one standard deviation (68 %) along the ray, metres.
        uv: (N, 2) float32, source pixel (x right, y down).
        extra: further columns by name, each (N,).
        shape: (rows, columns) of an organised cloud, N = rows * columns; None otherwise.
    """

    xyz: AnyArray
    frame: str
    timestamp_ns: int = 0
    rgb: UInt8 | None = None
    intensity: Float32 | None = None
    sigma_m: Float32 | None = None
    uv: Float32 | None = None
    extra: Mapping[str, AnyArray] = field(default_factory=dict)
    shape: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        check_array("PointCloud", "xyz", self.xyz, (None, 3), *XYZ)
        n = len(self.xyz)
        if self.rgb is not None:
            check_array("PointCloud", "rgb", self.rgb, (n, 3), np.uint8)
        for name in ("intensity", "sigma_m"):
            column = getattr(self, name)
            if column is not None:
                check_array("PointCloud", name, column, (n,), np.float32)
        if self.uv is not None:
            check_array("PointCloud", "uv", self.uv, (n, 2), np.float32)
        for name, column in self.extra.items():
            if column.shape[:1] != (n,):
                raise StructureError(
                    f"{len(column)} values", want=str(n), where=f"PointCloud.extra[{name!r}]"
                )
        if self.shape is not None and self.shape[0] * self.shape[1] != n:
            raise StructureError(f"{n} points", want=f"{self.shape}", where="PointCloud.shape")

    def __len__(self) -> int:
        return len(self.xyz)

    def __getitem__(self, index: Bool | Int64 | slice) -> PointCloud:
        """The chosen points with all their columns; the result is not organised.

        Raises:
            IndexError: a mask of another length, or a position outside the cloud.
        """
        positions = _positions(index, len(self))

        def take(column: AnyArray) -> AnyArray:
            if isinstance(positions, slice):
                return column[positions]
            return column.take(positions, axis=0)

        def take_known(column: AnyArray | None) -> AnyArray | None:
            return None if column is None else take(column)

        return replace(
            self,
            xyz=take(self.xyz),
            rgb=take_known(self.rgb),
            intensity=take_known(self.intensity),
            sigma_m=take_known(self.sigma_m),
            uv=take_known(self.uv),
            extra={name: take(column) for name, column in self.extra.items()},
            shape=None,
        )

    @property
    def valid(self) -> Bool:
        """(N,) points whose coordinates are finite."""
        x, y, z = self.xyz.T  # column by column takes a tenth of the time of `all` along rows
        return np.asarray(np.isfinite(x) & np.isfinite(y) & np.isfinite(z))

    def transformed(self, T_dst_frame: Pose) -> PointCloud:
        """The cloud in frame `T_dst_frame.dst`; sigma is along the ray and stays.

        Raises:
            StructureError: the cloud is in another frame than `T_dst_frame.src`.
        """
        if T_dst_frame.src != self.frame:
            raise StructureError(
                f"a cloud in {self.frame!r}", want=f"one in {T_dst_frame.src!r}", where="PointCloud"
            )
        return replace(self, xyz=T_dst_frame.apply(self.xyz), frame=T_dst_frame.dst)


def _positions(index: Bool | Int64 | slice, length: int) -> Int64 | slice:
    """A mask as positions, counted once for all columns.

    Rows of an (N, 3) array are taken by positions in a twentieth of the time that a mask needs
    (numpy 2.4, 400 000 points: 0.7 ms and 17 ms).
    """
    if isinstance(index, slice) or index.dtype != np.bool_:
        return cast("Int64 | slice", index)
    if index.shape != (length,):
        raise IndexError(f"a mask of shape {index.shape} for {length} points")
    return np.flatnonzero(index)
