"""Which pixels of a fused frame become points of a map, and what is known of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.mapping.fusion import FusedFrame, camera_numbers
from pseudolidar.structures.arrays import Float32, Float64, UInt8

# Pixels to either side that the slope of a surface is taken over, and its largest bend, px.
SLOPE_PX, MOST_BENT_PX = 2, 1.0


@dataclass(frozen=True)
class MapPoints:
    """Which pixels are sure enough for a map.

    Args:
        frames: so many frames must agree on a pixel.
        sigma: points with a larger one are left out, m: it decides how far the map reaches.
        nearest: points nearer than this are left out, m.
    """

    frames: int = 3
    sigma: float = 0.12
    nearest: float = 1.0

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise UsageError(f"{self.frames} frames", want="at least 1", where="points.frames")
        for name in ("sigma", "nearest"):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise UsageError(f"{value:g} m", want="above 0", where=f"points.{name}")

    def of(self, fused: FusedFrame, rgb: UInt8) -> FramePoints:
        """The points of a frame.

        Args:
            fused: its disparities, with those of the frames before.
            rgb: (H, W, 3) of its left picture.
        """
        from pseudolidar.mapping.fusion_kernels import surface

        planes = np.stack([fused.inverse_depth, fused.variance])
        normals = np.zeros((3, *fused.counts.shape), np.float32)
        fine = np.zeros(fused.counts.shape, np.bool_)
        limits = np.array([SLOPE_PX, MOST_BENT_PX], np.float32)
        surface(planes, camera_numbers(fused.rig), limits, normals, fine)
        fine &= fused.counts >= self.frames
        row, column = np.nonzero(fine)
        z, sigma_m = fused.depth_m[row, column], fused.sigma_m[row, column]
        sure = (z >= self.nearest) & (sigma_m <= self.sigma)
        row, column, z, sigma_m = row[sure], column[sure], z[sure], sigma_m[sure]
        K = fused.rig.left.K
        x, y = (column - K[0, 2]) / K[0, 0] * z, (row - K[1, 2]) / K[1, 1] * z
        xyz = np.stack([x, y, z], axis=1).astype(np.float32)
        return FramePoints(xyz, normals[:, row, column].T.copy(), rgb[row, column], sigma_m)


@dataclass(frozen=True, eq=False)
class FramePoints:
    """Points of one frame, in its left camera.

    Args:
        xyz: (N, 3) float32 m.
        normals: (N, 3) float32, towards the camera.
        rgb: (N, 3) uint8.
        sigma_m: (N,) float32 one standard deviation of the depth.
    """

    xyz: Float32
    normals: Float32
    rgb: UInt8
    sigma_m: Float32

    def __len__(self) -> int:
        return len(self.xyz)

    def in_map(self, T_map_camera: Float64) -> tuple[Float64, Float32]:
        """(N, 3) places and (N, 3) normals in the map."""
        R, t = T_map_camera[:3, :3], T_map_camera[:3, 3]
        places = np.einsum("ij,nj->ni", R, self.xyz.astype(np.float64)) + t
        return places, np.einsum("ij,nj->ni", R, self.normals).astype(np.float32)
