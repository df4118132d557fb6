"""Disparity map to point cloud, with colour, sigma along the ray and source pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.errors import StereoConfig, StructureError
from pseudolidar.geometry.grey import LUMA, shift_to_8_bits
from pseudolidar.geometry.triangulation import forward_offset_m
from pseudolidar.stereo.depth_points import points_of_depth
from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame

# Range up to which stereo of a car's size is of use, m; at 80 m a KITTI rig has 5 px of disparity.
MAX_RANGE_M = 80.0


@dataclass(frozen=True)
class Reproject:
    """Which pixels become points, and how.

    Args:
        via: triangulate by the matrix Q, or by solving the projection equations of P_left, P_right;
            both give the same points.
        organised: keep every pixel at its place, NaN where there is no point.
        min_range_m: drop points nearer than this.
        max_range_m: drop points farther than this.
        min_height_m: drop points lower than this; above the left camera, along its -y.
        max_height_m: drop points higher than this; above the left camera, along its -y.
        max_sigma_m: drop points with a larger error along the ray (68 %).
        max_sigma_rel: drop points with a larger error along the ray, relative to their range.
        voxel_m: keep one point, the surest, of each cube with this edge.
        depth_sigma_rel: error (68 %) of depths that come ready-made without one, as a share of
            the depth; without it their sigma is unknown.
    """

    via: Literal["q", "p"] = "q"
    organised: bool = False
    min_range_m: float = 0.0
    max_range_m: float = MAX_RANGE_M
    min_height_m: float | None = None
    max_height_m: float | None = None
    max_sigma_m: float | None = None
    max_sigma_rel: float | None = None
    voxel_m: float | None = None
    depth_sigma_rel: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.min_range_m < self.max_range_m:
            raise StereoConfig(
                f"ranges {self.min_range_m:g} to {self.max_range_m:g} m",
                want="0 <= min_range_m < max_range_m",
            )
        for name in ("voxel_m", "max_sigma_m", "max_sigma_rel", "depth_sigma_rel"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise StereoConfig(f"{name} = {value:g}", want="a positive number")
        if self.organised and self.voxel_m is not None:
            raise StereoConfig(
                "voxel thinning of an organised cloud",
                want="one of the two",
                fix="Leave out voxel_m or organised.",
            )

    def load(self) -> Reprojector:
        """The reprojector, its kernel compiled or read from the cache."""
        from pseudolidar.stereo import reproject_kernel  # noqa: F401  compiles on import

        return Reprojector(self)

    @property
    def gates(self) -> Float64:
        """(6,) limits of range, height and sigma; infinite where there is none."""
        low, high = self.min_height_m, self.max_height_m
        return np.array(
            [
                self.min_range_m,
                self.max_range_m,
                -math.inf if low is None else low,
                math.inf if high is None else high,
                math.inf if self.max_sigma_m is None else self.max_sigma_m,
                math.inf if self.max_sigma_rel is None else self.max_sigma_rel,
            ]
        )


@dataclass(frozen=True)
class Reprojector:
    """Makes the cloud of a frame; picklable, callable from several threads."""

    settings: Reproject

    def __call__(self, frame: StereoFrame, disparity: DisparityMap) -> PointCloud:
        """Triangulate a disparity map into points in the left camera's frame.

        Z = (f B + u_right tz) / (d + doffs), where d has the rig's systematic error taken off (it
        is done here and nowhere else). The ray error grows as dZ/dd * |ray| / Z * sigma_d, where
        sigma_d^2 = sigma_match^2 + sigma_systematic^2. Disparities at or beyond infinity give no
        point.

        Args:
            frame: rectified pair; its left image gives colour (None for grey images) and
                intensity.
            disparity: (H, W) px, NaN where unknown. Without sigma (ground truth) the cloud has
                none.

        Returns:
            Points in frame `rig.left.frame`, row-major pixel order.

        Raises:
            StructureError: the disparity map has another size than the image.
            StereoConfig: a gate on sigma for a disparity map without sigma.

        Source: Hartley & Zisserman, Multiple View Geometry, 2nd ed., section 12.2; error model:
            Gallup et al., Variable Baseline/Resolution Stereo, CVPR 2008.
        """
        if disparity.values.shape != frame.left.shape[:2]:
            raise StructureError(
                f"disparity of shape {disparity.values.shape}",
                want=f"{frame.left.shape[:2]}, the image's",
                where=frame.id,
            )
        if disparity.sigma is None and np.isfinite(self.settings.gates[4:]).any():
            raise StereoConfig(
                "a limit on sigma, but the disparity has no sigma",
                want="a disparity with its sigma",
                fix="Leave out max_sigma_m and max_sigma_rel, or take a matcher that estimates it.",
            )
        cloud = _cloud(frame, disparity, self.settings)
        return cloud if self.settings.voxel_m is None else _thinned(cloud, self.settings.voxel_m)

    def of_depth(self, frame: DepthFrame) -> PointCloud:
        """Points of ready-made depth, in the frame of its camera; as `points_of_depth`."""
        return points_of_depth(
            frame,
            self.settings.gates,
            sigma_rel=self.settings.depth_sigma_rel,
            organised=self.settings.organised,
            voxel_m=self.settings.voxel_m,
        )


def _cloud(frame: StereoFrame, disparity: DisparityMap, settings: Reproject) -> PointCloud:
    from pseudolidar.stereo.reproject_kernel import count_valid, reproject_pixels

    values = np.ascontiguousarray(disparity.values)
    sigma = disparity.sigma
    image, levels = _image8(frame)
    size = values.size if settings.organised else count_valid(values)
    xyz, uv = np.empty((size, 3), np.float32), np.empty((size, 2), np.float32)
    rgb = np.empty((size if image.shape[2] == 3 else 0, 3), np.uint8)
    grey = np.empty(size, np.float32)
    ray = np.empty(0 if sigma is None else size, np.float32)
    n = reproject_pixels(
        values,
        np.empty((0, 0), np.float32) if sigma is None else np.ascontiguousarray(sigma),
        image,
        settings.via == "p",
        *_calibration(frame.rig),
        settings.gates,
        settings.organised,
        *(xyz, rgb, grey, ray, uv),
    )
    if levels is not None:
        grey[:n] = levels[uv[:n, 1].astype(np.intp), uv[:n, 0].astype(np.intp)]
    return PointCloud(
        xyz=xyz[:n],
        frame=frame.rig.left.frame,
        timestamp_ns=frame.timestamp_ns,
        rgb=rgb[:n] if len(rgb) or image.shape[2] == 3 else None,
        intensity=grey[:n],
        sigma_m=None if sigma is None else ray[:n],
        uv=uv[:n],
        shape=values.shape if settings.organised else None,
    )


def _calibration(rig: StereoRig) -> tuple[Float64, ...]:
    """Q, P_left, P_right, the correction's coefficients, `scale` and `pair` of the kernel."""
    none = np.zeros(DisparityCorrection.TERMS)
    correction = none if rig.correction is None else rig.correction.coefficients
    tz_m = forward_offset_m(rig)
    scale = np.stack([rig.sigma_scale.disparities_px, rig.sigma_scale.factors])
    pair = np.array([rig.doffs_px, tz_m / rig.fB_px_m, tz_m, rig.systematic_sigma_px])
    return rig.Q, rig.P_left, rig.P_right, np.ascontiguousarray(correction), scale, pair


def _image8(frame: StereoFrame) -> tuple[UInt8, Float32 | None]:
    """The left image as (H, W, C) uint8, and (H, W) exact intensities where it has more bits.

    16-bit images are shifted right by the bits that the brightest pixel of the pair has beyond 8,
    as for matching.
    """
    image = frame.left
    if image.dtype == np.uint8:
        stacked = image[:, :, None] if image.ndim == 2 else image
        return np.ascontiguousarray(stacked, np.uint8), None
    shift = shift_to_8_bits(image, frame.right)
    stacked = image[:, :, None] if image.ndim == 2 else image
    weights = LUMA if image.ndim == 3 else np.ones(1)
    levels = (stacked @ weights / ((256 << shift) - 1)).astype(np.float32)
    return np.ascontiguousarray(stacked >> shift, np.uint8), levels


def _thinned(cloud: PointCloud, voxel_m: float) -> PointCloud:
    from pseudolidar.geometry.voxels import best_of_voxel

    return cloud[best_of_voxel(cloud.xyz, cloud.sigma_m, voxel_m=voxel_m)]
