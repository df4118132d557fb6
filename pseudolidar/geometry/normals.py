"""Surface normals of points: from neighbouring pixels in inverse depth, or in space."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry import normal_kernels as kernels
from pseudolidar.structures.arrays import AnyArray, Float32, Float64
from pseudolidar.structures.pose import Pose


def normals_of_pixels(xyz: AnyArray, uv: Float32, T_camera_points: Pose) -> Float32:
    """Normals of points that know their pixels, from planes fitted in inverse depth.

    1 / Z is linear in (u, v) on a plane, and its error is the same near and far: neighbours of one
    surface are told by it, and no normal leans along the ray as fits in space do at range.

    Args:
        xyz: (N, 3) m, NaN where there is no point.
        uv: (N, 2) px, pixels of one camera; where two points share one the last counts.
        T_camera_points: from the points' frame to the camera's.

    Returns:
        (N, 3) float32 of length 1 in the frame of `xyz`, to the camera's side; NaN where fewer
        than half of the neighbours (every second of 13x13) belong to one surface.
    """
    n = len(xyz)
    column, row = np.rint(np.nan_to_num(uv, nan=-1.0)).astype(np.int64).T
    there = np.isfinite(xyz).all(axis=1) & (column >= 0) & (row >= 0)
    if not there.any():
        return np.full((n, 3), np.nan, np.float32)
    rays = T_camera_points.apply(xyz[there].astype(np.float64)).T
    shape = int(row[there].max()) + 1, int(column[there].max()) + 1
    reach = kernels.REACH_PX
    padded = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach), np.float32)
    with np.errstate(divide="ignore"):
        inverse = np.where(rays[2] > 0, 1 / rays[2], 0)
    padded[row[there] + reach, column[there] + reach] = inverse
    # The pixel's ray (x, y, 1) is (u - cx) / f in both directions: solved for, so that no camera
    # need be known.
    fu, cu = _line(column[there], rays[0] / rays[2])
    fv, cv = _line(row[there], rays[1] / rays[2])
    gradients = np.empty((3, *shape), np.float32)
    kernels.plane_gradients(padded, gradients)
    a, b, c = gradients[:, row[there], column[there]].astype(np.float64)
    # 1/Z = a u + b v + c0 = A x + B y + C on the plane A X + B Y + C Z = 1.
    A, B = a / fu, b / fv
    C = c - A * (cu + fu * column[there]) - B * (cv + fv * row[there])
    camera_normals = -np.stack([A, B, C], axis=1) / np.sqrt(A * A + B * B + C * C)[:, None]
    T_camera_turned = Pose.from_rotation(
        T_camera_points.dst, T_camera_points.src, T_camera_points.matrix[:3, :3], np.zeros(3)
    )
    normals = np.full((n, 3), np.nan, np.float32)
    normals[there] = T_camera_turned.inverse().apply(camera_normals)
    return normals


def _line(pixel: AnyArray, slope: Float64) -> tuple[float, float]:
    """`slope = f pixel + c` by least squares: 1 / focal length, and minus the centre over it.

    Sums instead of scalar products: BLAS rounds by its threads, and so by the machine.
    """
    centred = pixel - pixel.mean()
    f = float((centred * (slope - slope.mean())).sum() / max(float((centred**2).sum()), 1e-9))
    return f, float(slope.mean() - f * pixel.mean())


def normals_of_neighbours(xyz: AnyArray, origin_m: Float64, *, neighbours: int = 16) -> Float32:
    """Normals of points anywhere, from the plane through their nearest neighbours in space.

    Args:
        xyz: (N, 3) m, NaN where there is no point.
        origin_m: (3,) where they were seen from: the side that normals point to.
        neighbours: how many, the point itself included.

    Returns:
        (N, 3) float32 of length 1; NaN where neighbours lie on a line or are too few.
    """
    from scipy.spatial import cKDTree

    normals = np.full((len(xyz), 3), np.nan, np.float32)
    there = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    if len(there) < neighbours:
        return normals
    points = np.ascontiguousarray(xyz[there], np.float64)
    _, near = cKDTree(points).query(points, k=neighbours)
    found = np.empty((len(points), 3), np.float32)
    kernels.plane_normals(points, near, origin_m, found)
    normals[there] = found
    return normals
