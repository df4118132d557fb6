"""Planar patches of a disparity map: what registration can hold on to.

A pixel's depth is noisy and says nothing of the surface about it; a plane through a block of
disparities averages the noise and knows its normal, the same near and far, for 1 / Z is linear in
the picture on a plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.triangulation import corrected_disparity, points_by_q
from pseudolidar.mapping.patch_kernels import BLOCK_PX, COLUMNS, block_planes
from pseudolidar.structures.arrays import Bool, Float64, Int64, check_array
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap

# Planes with a rougher fit, px, hold more than one surface.
ROUGHEST_PX = 0.5
# One standard deviation of a patch's disparity, px: errors of matching are alike within a block,
# so it is no eighth of a pixel's. Measured between frames of KITTI, 2026-11.
SIGMA_PX = 0.1
# Nearer and farther patches are of no use, m.
NEAREST_M, FARTHEST_M = 0.5, 40.0


@dataclass(frozen=True, eq=False)
class Patches:
    """Small planar surfaces, as columns.

    Args:
        xyz: (N, 3) float64 m, their centres in the sensor's frame.
        normals: (N, 3) float64 of length 1, to the sensor's side.
        sigma_m: (N,) float64, one standard deviation of a centre along its normal.
    """

    xyz: Float64
    normals: Float64
    sigma_m: Float64

    def __post_init__(self) -> None:
        check_array("Patches", "xyz", self.xyz, (None, 3), np.float64)
        check_array("Patches", "normals", self.normals, (len(self), 3), np.float64)
        check_array("Patches", "sigma_m", self.sigma_m, (len(self),), np.float64)

    def __len__(self) -> int:
        return len(self.xyz)

    def __getitem__(self, index: Bool | Int64 | slice) -> Patches:
        """The chosen patches."""
        return Patches(self.xyz[index], self.normals[index], self.sigma_m[index])

    @property
    def depth_m(self) -> Float64:
        """(N,) along the optical axis."""
        return self.xyz[:, 2]


def find_patches(disparity: DisparityMap, rig: StereoRig) -> Patches:
    """Planar patches of a frame, in the left camera's frame.

    Args:
        disparity: of the left image, as matched.
        rig: rectified; its correction is taken off the centres.
    """
    height, width = disparity.values.shape
    planes = np.empty(((height // BLOCK_PX) * (width // BLOCK_PX), COLUMNS))
    planes = planes[: block_planes(disparity.values, planes)]
    u, v, d, a, b = planes[planes[:, 5] < ROUGHEST_PX, :5].T
    d = corrected_disparity(d, u, v, rig)
    with np.errstate(invalid="ignore"):
        xyz = points_by_q(d, u, v, rig)
        near = (xyz[:, 2] > NEAREST_M) & (xyz[:, 2] < FARTHEST_M)
    u, v, d, a, b, xyz = u[near], v[near], d[near], a[near], b[near], xyz[near]
    # f B = Z (d + doffs) with d linear in (u, v) is a plane in space.
    fx, fy = rig.left.K[0, 0], rig.left.K[1, 1]
    cx, cy = rig.left.K[0, 2], rig.left.K[1, 2]
    inward = np.column_stack([a * fx, b * fy, a * (cx - u) + b * (cy - v) + d + rig.doffs_px])
    normals = -inward / np.linalg.norm(inward, axis=1, keepdims=True)
    depth_m = xyz[:, 2]
    along_ray = np.abs(np.einsum("ij,ij->i", normals, xyz)) / depth_m
    return Patches(xyz, normals, along_ray * depth_m**2 * SIGMA_PX / rig.fB_px_m)
