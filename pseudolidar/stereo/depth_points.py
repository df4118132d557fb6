"""Ready-made depth to points, by the same gates as disparities: no matching, no rig."""

from __future__ import annotations

import numpy as np

from pseudolidar.errors import MapEmpty, StereoConfig
from pseudolidar.geometry.grey import LUMA, shift_to_8_bits
from pseudolidar.structures.arrays import Bool, Float32, Float64, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import DepthFrame


def points_of_depth(
    frame: DepthFrame,
    gates: Float64,
    *,
    sigma_rel: float | None = None,
    organised: bool = False,
    voxel_m: float | None = None,
) -> PointCloud:
    """The pixels of a depth picture as points in the frame of its camera.

    X = (u - cx - s Y') Z / fx, Y = (v - cy) Z / fy, with Z the depth along the optical axis, not
    the range.

    Args:
        frame: picture with the depth of its pixels; its colours are the points'.
        gates: (6,) limits as `stereo.reproject.Reproject.gates`.
        sigma_rel: error (68 %) of depths that come without one, as a share of the depth.
        organised: keep every pixel at its place, NaN where there is no point.
        voxel_m: keep one point, the surest, of each cube with this edge.

    Returns:
        Points in row-major pixel order, with `uv`; `sigma_m` along the ray where it is known.

    Raises:
        MapEmpty: no pixel has a depth.
        StereoConfig: a gate on sigma where none is known.

    Source: Hartley & Zisserman, Multiple View Geometry, 2nd ed., section 6.1.
    """
    depth = frame.depth
    if not depth.valid.any():
        raise MapEmpty(
            "no pixel has a depth",
            want="at least one",
            fix="Leave the frame out with --exclude.",
            where=f"frame {frame.id}",
        )
    sigma_z = depth.sigma
    if sigma_z is None and sigma_rel is not None:
        sigma_z = depth.values * np.float32(sigma_rel)
    if sigma_z is None and np.isfinite(gates[4:]).any():
        raise StereoConfig(
            "a limit on sigma, but the depth has no sigma",
            want="depth with its sigma",
            fix="Leave out max_sigma_m and max_sigma_rel, or state one by "
            "--reproject.depth-sigma-rel.",
        )
    xyz = _xyz(frame)
    range_m = np.sqrt((xyz.astype(np.float64) ** 2).sum(axis=2))
    sigma_m = None if sigma_z is None else (sigma_z * range_m / depth.values).astype(np.float32)
    kept = depth.valid & _within(range_m, -xyz[..., 1].astype(np.float64), sigma_m, gates)
    cloud = _cloud(frame, xyz, sigma_m, kept, organised=organised)
    if voxel_m is None:
        return cloud
    from pseudolidar.geometry.voxels import best_of_voxel

    return cloud[best_of_voxel(cloud.xyz, cloud.sigma_m, voxel_m=voxel_m)]


def _xyz(frame: DepthFrame) -> Float32:
    """(H, W, 3) float32 m, NaN where there is no depth."""
    height, width = frame.depth.values.shape
    rows, columns = np.arange(height)[:, None], np.arange(width)[None]
    K, Z = frame.camera.K, frame.depth.values.astype(np.float64)
    y = (rows - K[1, 2]) / K[1, 1]
    x = (columns - K[0, 2] - K[0, 1] * y) / K[0, 0]
    return np.stack([x * Z, y * Z, Z], axis=2).astype(np.float32)


def _within(range_m: Float64, height_m: Float64, sigma_m: Float32 | None, gates: Float64) -> Bool:
    near, far, low, high, most_m, most_rel = gates
    kept = (near <= range_m) & (range_m <= far) & (low <= height_m) & (height_m <= high)
    if sigma_m is not None:
        kept &= (sigma_m <= most_m) & (sigma_m <= most_rel * range_m)
    return np.asarray(kept)


def _cloud(
    frame: DepthFrame, xyz: Float32, sigma_m: Float32 | None, kept: Bool, *, organised: bool
) -> PointCloud:
    shape = kept.shape if organised else None
    if organised:
        xyz = np.where(kept[..., None], xyz, np.float32(np.nan))
        sigma_m = None if sigma_m is None else np.where(kept, sigma_m, np.float32(np.nan))
        kept = np.ones_like(kept)
    rows, columns = np.nonzero(kept)
    rgb, intensity = _colours(frame)
    return PointCloud(
        xyz=xyz[kept],
        frame=frame.camera.frame,
        timestamp_ns=frame.timestamp_ns,
        rgb=None if rgb is None else rgb[kept],
        intensity=intensity[kept],
        sigma_m=None if sigma_m is None else sigma_m[kept],
        uv=np.stack([columns, rows], axis=1).astype(np.float32),
        shape=None if shape is None else (shape[0], shape[1]),
    )


def _colours(frame: DepthFrame) -> tuple[UInt8 | None, Float32]:
    """(H, W, 3) RGB, None for grey pictures; (H, W) intensity 0-1."""
    image = frame.image
    shift = shift_to_8_bits(image)
    white = (256 << shift) - 1
    if image.ndim == 2:
        return None, (image / np.float64(white)).astype(np.float32)
    return (image >> shift).astype(np.uint8), (image @ LUMA / white).astype(np.float32)
