"""Points into images, and LiDAR scans into the left image without what the camera cannot see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import CalibrationField
from pseudolidar.structures.arrays import AnyArray, Bool, Float64, Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import LidarScan


# A Velodyne above the camera sees past edges that hide the background from the camera, so that
# points of the background land on nearer objects. A window of this size around a point meets
# beams of the near surface (an HDL-64's are 5 rows apart in a KITTI image). It reaches farther up
# than down, where the ground comes nearer by itself. Measured on KITTI stereo 2015: points that
# contradict the true disparity by 10 % drop from 2.7 % to 1.0 %, with 94 % of the points kept.
@dataclass(frozen=True)
class Occluders:
    """Where nearer points hide a point, and by how much nearer they must be.

    Args:
        above_px: rows above it.
        below_px: rows below it.
        beside_px: columns to each side.
        margin: as a share of the depth of the hidden point.
    """

    above_px: int = 6
    below_px: int = 2
    beside_px: int = 4
    margin: float = 0.1


OCCLUDERS = Occluders()


def px_per_radian(off_px: Float64, focal_px: float) -> Float64:
    """(N,) px that points of a picture move by along an axis for a turn of its camera, a radian.

    Args:
        off_px: (N,) where they are on that axis, from the principal point.
        focal_px: focal length.
    """
    tangent = off_px / focal_px
    return np.asarray(focal_px * (1.0 + tangent * tangent))


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
    scan: LidarScan, rig: StereoRig, *, occluders: Occluders = OCCLUDERS
) -> ProjectedScan:
    """Points of a LiDAR scan that the left camera can see, z-buffered.

    Args:
        scan: in frame `velodyne`, or already in the left camera's.
        rig: with `T_left_velodyne`.
        occluders: which nearer points hide others.

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
    seen = visible(uv, depth_m, (width, height), occluders=occluders)
    return ProjectedScan(uv[seen], depth_m[seen], index[seen])


def visible(
    uv: Float64, depth_m: Float64, size_px: tuple[int, int], *, occluders: Occluders = OCCLUDERS
) -> Bool:
    """(N,) points that no nearer point hides, in an image of `size_px` (width, height)."""
    from scipy.ndimage import minimum_filter

    width, height = size_px
    column, row = np.rint(uv).astype(np.intp).T
    nearest = np.full((height, width), np.inf)
    np.minimum.at(nearest, (row, column), depth_m)
    window = occluders.above_px + 1 + occluders.below_px, 2 * occluders.beside_px + 1
    # scipy centres a window of even length right of its middle; origin shifts it upwards.
    front: Float64 = minimum_filter(
        nearest,
        size=window,
        mode="constant",
        cval=np.inf,
        origin=(occluders.above_px - window[0] // 2, 0),
    )
    return np.asarray(depth_m * (1.0 - occluders.margin) <= front[row, column])
