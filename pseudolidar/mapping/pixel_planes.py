"""Each pixel of a depth map as a little plane with the weight that its sigma gives it."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry import normal_kernels
from pseudolidar.mapping import tsdf_kernels as kernels
from pseudolidar.structures.arrays import Bool, Float32
from pseudolidar.structures.camera import Camera

# Neighbours whose inverse depths differ by this share belong to two surfaces.
EDGE_SHARE = 0.1
# Distances reach this many sigmas to each side of a surface, within these bounds in voxels: below
# three, marching cubes finds no voxel on the other side of a slanted one.
REACH_SIGMAS, LEAST_REACH, MOST_REACH = 3.0, 3.0, 8.0
# No surface is placed better than this share of a voxel: poses and grid have errors too.
PLACED_VOXELS = 0.25
# A surface seen at a more grazing angle (cosine) is as uncertain as one at this.
LEAST_COSINE = 0.05


def pixel_planes(
    depth_m: Float32, sigma_m: Float32, camera: Camera, *, voxel_m: float, max_sigma_m: float
) -> Float32:
    """Planes through the pixels of a depth map, as `tsdf_kernels` takes them.

    The error of a depth moves a point along its ray: across a surface it is smaller by the cosine
    between ray and normal. The weight of a pixel is one over the square of that, 1/m^2.

    Args:
        depth_m: (H, W) depth Z, NaN where there is none.
        sigma_m: (H, W) one standard deviation of it.
        camera: of the depth map, without distortion.
        voxel_m: side of a voxel.
        max_sigma_m: pixels that are less sure are not used.

    Returns:
        (H, W, PLANE_COLUMNS) float32; weight 0 where a pixel is not used.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(depth_m > 0, 1 / depth_m, 0).astype(np.float32)
        used = (inverse > 0) & (sigma_m <= max_sigma_m) & ~_between(inverse)
    normals = _normals(inverse, camera)
    planes = np.zeros((*depth_m.shape, kernels.PLANE_COLUMNS), np.float32)
    rows, columns = np.nonzero(used)
    z, n = depth_m[used], normals[:, rows, columns]
    K = camera.K
    points = np.stack([(columns - K[0, 2]) / K[0, 0] * z, (rows - K[1, 2]) / K[1, 1] * z, z])
    range_m = np.sqrt((points**2).sum(axis=0))
    # What is too small or too thin for a plane faces the camera.
    n = np.where(np.isfinite(n[0]), n, -points / range_m)
    offset = (n * points).sum(axis=0)
    cosine = np.maximum(-offset / range_m, LEAST_COSINE)
    across = np.hypot(sigma_m[used] * range_m / z * cosine, PLACED_VOXELS * voxel_m)
    reach = np.clip(REACH_SIGMAS * across, LEAST_REACH * voxel_m, MOST_REACH * voxel_m)
    planes[rows, columns] = np.stack(
        [*n, offset, z, reach, 1 / across**2], axis=1, dtype=np.float32
    )
    return planes


def _normals(inverse: Float32, camera: Camera) -> Float32:
    """(3, H, W) normals to the camera's side, NaN where a pixel has no plane.

    On a plane 1 / Z = A X / Z + B Y / Z + C, so its slopes along u and v are A / fx and B / fy.
    """
    reach = normal_kernels.REACH_PX
    slopes = np.empty((3, *inverse.shape), np.float32)
    normal_kernels.plane_gradients(np.pad(inverse, reach), slopes)
    fx, fy, cx, cy = (np.float32(camera.K[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    v, u = np.ogrid[: inverse.shape[0], : inverse.shape[1]]
    A, B = slopes[0] * fx, slopes[1] * fy
    C = (
        slopes[2]
        - slopes[0] * (u.astype(np.float32) - cx)
        - slopes[1] * (v.astype(np.float32) - cy)
    )
    return np.asarray(-np.stack([A, B, C]) / np.sqrt(A * A + B * B + C * C), np.float32)


def _between(inverse: Float32) -> Bool:
    """(H, W) pixels with a much nearer neighbour and a much farther one: on neither surface."""
    nearer, farther = np.zeros(inverse.shape, bool), np.zeros(inverse.shape, bool)
    for a, b in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        for here, there in ((a, b), (b, a)):
            known = (inverse[here] > 0) & (inverse[there] > 0)
            step = inverse[there] - inverse[here]
            limit = EDGE_SHARE * inverse[here]
            nearer[here] |= known & (step > limit)
            farther[here] |= known & (step < -limit)
    return nearer & farther
