"""The plane that a vehicle stands on: seeded RANSAC, then robust least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.planes import Plane
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

# One point, the surest, of each cube of this edge: surfaces count by their area, not by how many
# pixels see them.
CUBE_M = 0.4
MOST_POINTS = 100_000  # of those below the sensor that are looked at, evenly
# Where the ground is looked for: so far, horizontally, and so much below the sensor.
NEAREST_M, FARTHEST_M, LEAST_BELOW_M = 2.0, 35.0, 0.3
HYPOTHESES, SAMPLES, SEED = 200, 1500, 20251125
# Unevenness of a road and its verge, one standard deviation, m; and the loss beyond so many sigmas.
ROUGHNESS_M, CUT_SIGMAS = 0.04, 3.0
# A point below the ground contradicts it more than one above: so many times.
BELOW_FACTOR = 2.0
HEIGHT_SIGMAS = 4.0  # planes farther from a known height are none
ITERATIONS = 8
# A plane is the ground if so many cubes, and this share of all that lie low, belong to it.
LEAST_CUBES, LEAST_SHARE = 60, 0.15


@dataclass(frozen=True)
class GroundFit:
    """How the ground is looked for. The prior is the mounting: no frame depends on others.

    Args:
        tilt_deg: largest angle between the ground's normal and the sensor's up.
        tilt_sigma_deg: how level the sensor is mounted, one standard deviation.
        height_m: height of the sensor above the ground, where it is known.
        height_sigma_m: how well.
        thickness_m: points this close to the plane are ground, and those within their own error.
    """

    tilt_deg: float = 12.0
    tilt_sigma_deg: float = 3.0
    height_m: float | None = None
    height_sigma_m: float = 0.1
    thickness_m: float = 0.15


def fit_ground(
    cloud: PointCloud, T_forward_cloud: Pose, origin_m: Float64, settings: GroundFit
) -> Plane | None:
    """The ground in a frame with z up; None where too little of it is seen.

    Args:
        cloud: points, in any frame.
        T_forward_cloud: to the frame with z up.
        origin_m: (3,) where the points were seen from, in that frame.
        settings: prior and limits.

    Source: RANSAC with a truncated loss (MSAC: Torr & Zisserman, MLESAC, CVIU 78, 2000), then
        iteratively reweighted least squares with Tukey's weights.
    """
    points, across = _low_points(cloud, T_forward_cloud, origin_m)
    if len(points) < LEAST_CUBES:
        return None
    start = _ransac(points, across, origin_m, settings)
    if start is None:
        return None
    a, b, c = _refined(start, points, across, settings, origin_m)
    off = points[:, 2] - a * points[:, 0] - b * points[:, 1] - c
    members = np.abs(off) < CUT_SIGMAS * across
    if members.sum() < max(LEAST_CUBES, LEAST_SHARE * len(points)):
        return None
    return Plane.of(T_forward_cloud.dst, np.array([-a, -b, 1.0]), -c)


def ground_points(
    plane: Plane, cloud: PointCloud, T_plane_cloud: Pose, origin_m: Float64, settings: GroundFit
) -> Bool:
    """(N,) points that lie on the plane, as far as their errors tell."""
    from pseudolidar.clouds.ground_kernels import points_on_plane

    kind = cloud.xyz.dtype
    return np.asarray(
        points_on_plane(
            np.ascontiguousarray(cloud.xyz),
            np.empty(0, np.float32) if cloud.sigma_m is None else cloud.sigma_m,
            T_plane_cloud.matrix[:3].astype(kind),
            np.array([*plane.normal, plane.offset_m]).astype(kind),
            origin_m.astype(kind),
            float(plane.heights_m(origin_m[None])[0]),
            settings.thickness_m,
        )
    )


def _low_points(
    cloud: PointCloud, T_forward_cloud: Pose, origin_m: Float64
) -> tuple[Float64, Float64]:
    """(M, 3) surest points of cubes below the sensor, and (M,) their error across a level plane."""
    from pseudolidar.clouds.ground_kernels import low_points
    from pseudolidar.geometry.voxels import best_of_voxel

    index, low = low_points(
        np.ascontiguousarray(cloud.xyz),
        T_forward_cloud.matrix[:3].astype(cloud.xyz.dtype),
        origin_m,
        *(LEAST_BELOW_M, NEAREST_M, FARTHEST_M, MOST_POINTS),
    )
    surest = None if cloud.sigma_m is None else cloud.sigma_m[index]
    best = best_of_voxel(low, surest, voxel_m=CUBE_M)
    points = low[best].astype(np.float64)
    across = np.full(len(points), ROUGHNESS_M)
    if surest is not None:
        ray = points - origin_m
        slant = np.abs(ray[:, 2]) / np.linalg.norm(ray, axis=1)
        across = np.hypot(across, slant * np.nan_to_num(surest[best], nan=1.0))
    return points, across


def _ransac(
    points: Float64, across: Float64, origin_m: Float64, settings: GroundFit
) -> Float64 | None:
    """(3,) a, b, c of z = a x + b y + c with the least truncated loss; None: all too steep."""
    from pseudolidar.clouds.ground_kernels import misfits

    rng = np.random.default_rng(SEED)
    step = max(1, len(points) // SAMPLES)
    seen, sigma = points[::step], across[::step]
    triples = rng.integers(0, len(points), (HYPOTHESES, 3))
    corners = points[triples]
    matrix = np.concatenate([corners[:, :, :2], np.ones((HYPOTHESES, 3, 1))], axis=2)
    flat = np.abs(np.linalg.det(matrix)) < 1.0  # area of the triangle from above, 2 m^2
    matrix[flat] = np.eye(3)
    planes = np.linalg.solve(matrix, corners[:, :, 2:])[:, :, 0]
    steep = np.hypot(planes[:, 0], planes[:, 1]) > np.tan(np.radians(settings.tilt_deg))
    possible = ~flat & ~steep
    if settings.height_m is not None:
        off_m = np.abs(origin_m[2] - planes[:, 2] - settings.height_m)
        possible &= off_m < max(HEIGHT_SIGMAS * settings.height_sigma_m, ROUGHNESS_M)
    planes = planes[possible]
    if not len(planes):
        return None
    loss = misfits(
        np.ascontiguousarray(planes),
        np.ascontiguousarray(seen),
        np.ascontiguousarray(sigma),
        CUT_SIGMAS,
        BELOW_FACTOR,
    )
    score = loss + _prior(planes, settings, origin_m)
    return np.asarray(planes[int(np.argmin(score))])


def _prior(planes: Float64, settings: GroundFit, origin_m: Float64) -> Float64:
    """(K,) squared deviations from the mounting, in sigmas."""
    tilt = np.hypot(planes[:, 0], planes[:, 1]) / np.tan(np.radians(settings.tilt_sigma_deg))
    total = tilt**2
    if settings.height_m is not None:
        height = origin_m[2] - planes[:, 2]
        total = total + ((height - settings.height_m) / settings.height_sigma_m) ** 2
    return np.asarray(total)


def _refined(
    plane: Float64, points: Float64, across: Float64, settings: GroundFit, origin_m: Float64
) -> Float64:
    """The plane (a, b, c) that a few rounds of reweighted least squares lead to."""
    x, y, z = points.T
    columns = (x, y, np.ones(len(points)))
    slope = 1 / np.tan(np.radians(settings.tilt_sigma_deg))
    information = np.diag([slope**2, slope**2, 0.0])
    target = np.zeros(3)
    if settings.height_m is not None:
        information[2, 2] = 1 / settings.height_sigma_m**2
        target[2] = information[2, 2] * (origin_m[2] - settings.height_m)
    for _ in range(ITERATIONS):
        ratio = (z - plane[0] * x - plane[1] * y - plane[2]) / (CUT_SIGMAS * across)
        tukey = np.where(np.abs(ratio) < 1, (1 - ratio**2) ** 2, 0.0)
        weights = tukey / across**2
        weighed = [column * weights for column in columns]
        # Sums by numpy: BLAS rounds by its threads, and so by the machine.
        products = np.array([[(w * column).sum() for column in columns] for w in weighed])
        heights = np.array([(w * z).sum() for w in weighed])
        plane = np.asarray(np.linalg.solve(products + information, heights + target))
    return plane
