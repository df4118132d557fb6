"""Points into images, and LiDAR scans into the left image without what the camera cannot see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import CalibrationField
from pseudolidar.structures.arrays import AnyArray, Bool, Float64, Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import LidarScan

# A Velodyne above the camera sees past edges that hide the background from the camera. Beams of an
# HDL-64 are 4-8 px apart in a KITTI image, so this window meets the next beam of a near surface.
WINDOW_PX = 4
# A point hides another when it is nearer by this share of the other's depth: more than the slope
# of a surface makes within the window, less than the gap between objects.
HIDDEN_MARGIN = 0.1


@dataclass(frozen=True, eq=False)
class ProjectedScan:
    """Points of a scan as the left camera sees them.

    Args:
        uv: (N, 2) float64 pixel.
        depth_m: (N,) float64 Z in the left camera's frame.
        index: (N,) int64 position in the scan.
    """

    uv: Float64
    depth_m: Float64
    index: Int64


def project(xyz: AnyArray, P: Float64) -> tuple[Float64, Float64]:
    """Image coordinates of points.

    Args:
        xyz: (N, 3) m, in the frame that `P` projects from.
        P: (3, 4) projection.

    Returns:
        (N, 2) uv px, NaN behind the camera, and (N,) depth along its optical axis, m.
    """
    homogeneous = xyz.astype(np.float64) @ P[:, :3].T + P[:, 3]
    depth_m = homogeneous[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = homogeneous[:, :2] / depth_m[:, None]
    uv[~(depth_m > 0)] = np.nan
    return uv, depth_m


def project_scan(
    scan: LidarScan, rig: StereoRig, *, window_px: int = WINDOW_PX, margin: float = HIDDEN_MARGIN
) -> ProjectedScan:
    """Points of a LiDAR scan that the left camera can see, z-buffered.

    Args:
        scan: in frame `velodyne`, or already in the left camera's.
        rig: with `T_left_velodyne`.
        window_px: a nearer point hides others up to this far, columns and rows.
        margin: by how much nearer it must be, as a share of the hidden point's depth.

    Raises:
        CalibrationField: the rig does not know where the LiDAR is.
    """
    xyz = scan.xyz.astype(np.float64)
    if scan.frame != rig.left.frame:
        if rig.T_left_velodyne is None or rig.T_left_velodyne.src != scan.frame:
            raise CalibrationField(
                f"a scan in frame {scan.frame!r} without its place relative to the camera",
                want="T_left_velodyne in the calibration",
            )
        xyz = rig.T_left_velodyne.apply(xyz)
    uv, depth_m = project(xyz, rig.P_left)
    width, height = rig.left.size_px
    column, row = np.rint(np.nan_to_num(uv, nan=-1.0)).T
    index = np.flatnonzero((column >= 0) & (column < width) & (row >= 0) & (row < height))
    uv, depth_m = uv[index], depth_m[index]
    seen = visible(uv, depth_m, (width, height), window_px=window_px, margin=margin)
    return ProjectedScan(uv[seen], depth_m[seen], index[seen])


def visible(
    uv: Float64, depth_m: Float64, size_px: tuple[int, int], *, window_px: int, margin: float
) -> Bool:
    """(N,) points that no nearer point hides, in an image of `size_px` (width, height)."""
    width, height = size_px
    column, row = np.rint(uv).astype(np.intp).T
    nearest = np.full((height, width), np.inf, np.float32)
    np.minimum.at(nearest, (row, column), depth_m.astype(np.float32))
    side = 2 * window_px + 1
    front = _minimum_filter(nearest, side)
    return np.asarray(depth_m <= front[row, column] / (1.0 - margin))


def _minimum_filter(image: AnyArray, side: int) -> AnyArray:
    from scipy.ndimage import minimum_filter

    return np.asarray(minimum_filter(image, size=side, mode="nearest"))
