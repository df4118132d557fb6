"""How a stereo camera moved, from points that it saw before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.triangulation import points_by_q
from pseudolidar.geometry.twists import exp_twist, skew
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.point_tracks import PointTracks

# Error of a point found by Lucas-Kanade, px, in each of u, v and disparity.
TRACK_SIGMA_PX = 0.25
# A first pose comes from so many random choices of points, each as good as it explains to 1 px.
RANSAC_TRIES, RANSAC_INLIER_PX, RANSAC_CONFIDENCE = 300, 1.0, 0.9999
# Disparities (plus doffs) and depths are kept above these, so that a step too far stays finite:
# such a point has a large residual and no weight.
LEAST_PX, NEAREST_M = 0.2, 0.1
# Fewer points are no evidence of a pose: six numbers, and others that agree.
MIN_POINTS = 20
# Residuals beyond so many sigma count little: they are wrong tracks, or things that move.
KERNEL_SIGMA = 3.0
# Cauchy weights at first, which pull from far; then Geman-McClure's, which forget what is wrong.
CAUCHY_ITERATIONS, MAX_ITERATIONS, CONVERGED = 3, 15, 1e-6


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals of tracks at one pose, in (u, v, d) of the second pair, and how they change.

    Args:
        error: (N, 3) px, measured less predicted.
        by_pose: (N, 3, 6) change of the prediction with a twist on the left of `T_to_from`.
        by_seed: (N, 3) change of the prediction with the first pair's disparity.
    """

    error: Float64
    by_pose: Float64
    by_seed: Float64

    def whitened(self, columns: Float64) -> Float64:
        """`S^-1 columns` of (N, 3, k), with S = sigma^2 (I + g g^T) of tracks and their seed."""
        g = self.by_seed[:, :, None]
        along = np.sum(g * columns, axis=1, keepdims=True)
        shared = g * along / (1.0 + np.sum(g * g, axis=1, keepdims=True))
        return np.asarray((columns - shared) / TRACK_SIGMA_PX**2)

    @property
    def chi2(self) -> Float64:
        """(N,) squared residuals in units of their variance."""
        error = self.error[:, :, None]
        return np.asarray(np.sum(error * self.whitened(error), axis=(1, 2)))

    def weights(self, *, forgetting: bool) -> Float64:
        """(N,) 0-1: Cauchy's, or Geman-McClure's, which forget outliers."""
        weight = 1.0 / (1.0 + self.chi2 / KERNEL_SIGMA**2)
        return np.asarray(weight**2 if forgetting else weight)


def linearised(
    T_to_from: Float64, tracks: PointTracks, rig: StereoRig, *, offset_px: Float64 | float = 0.0
) -> Linearised:
    """Residuals of `tracks` where the camera moved by `T_to_from`.

    Args:
        T_to_from: (4, 4) maps points of the first left camera to the second one.
        tracks: measured.
        rig: rectified.
        offset_px: what the measured disparities are too large by, of the first and the second
            pair: (2, N), or one number.
    """
    offset_from, offset_to = np.broadcast_to(offset_px, (2, len(tracks)))
    d_from = np.maximum(tracks.d_from - offset_from, LEAST_PX - rig.doffs_px)
    R = T_to_from[:3, :3]
    points = points_by_q(d_from, tracks.uv_from[:, 0], tracks.uv_from[:, 1], rig)
    turned = points @ R.T
    moved = turned + T_to_from[:3, 3]
    seen, by_point = _seen(moved, rig)
    measured = np.column_stack([tracks.uv_to, tracks.d_to - offset_to])
    by_pose = np.concatenate([by_point, -by_point @ skew(moved)], axis=2)
    by_disparity = -turned / (d_from + rig.doffs_px)[:, None]
    by_seed = np.sum(by_point * by_disparity[:, None, :], axis=2)
    return Linearised(measured - seen, by_pose, by_seed)


def _seen(points: Float64, rig: StereoRig) -> tuple[Float64, Float64]:
    """(N, 3) u, v, d of points (N, 3) m of the left camera, and (N, 3, 3) how they change."""
    K, (x, y, z) = rig.left.K, points.T
    z = np.maximum(z, NEAREST_M)
    seen = np.column_stack(
        [K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2], rig.fB_px_m / z - rig.doffs_px]
    )
    change = np.zeros((len(points), 3, 3))
    change[:, 0, 0], change[:, 0, 2] = K[0, 0] / z, -K[0, 0] * x / z**2
    change[:, 1, 1], change[:, 1, 2] = K[1, 1] / z, -K[1, 1] * y / z**2
    change[:, 2, 2] = -rig.fB_px_m / z**2
    return seen, change


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """`H x = b` of a twist on the left of `T_to_from`, and of the disparities' offset and bend.

    Args:
        H: (8, 8); the twist first, then `1 + x^2` and `x^2` in the tangent of the angle to the
            optical axis, px.
        b: (8,).
        weights: (N,) 0-1 of the tracks.
    """

    H: Float64
    b: Float64
    weights: Float64


def normal_equations(
    T_to_from: Float64,
    tracks: PointTracks,
    rig: StereoRig,
    *,
    offset_px: Float64 | float = 0.0,
    sigma_px: float = TRACK_SIGMA_PX,
    forgetting: bool,
) -> NormalEquations:
    """Of the residuals of `linearised`, with the same arguments, weighted as its `weights`.

    `sigma_px` is the error of a point in each of u, v and d.
    """
    from pseudolidar.geometry.motion_kernels import UNKNOWNS
    from pseudolidar.geometry.motion_kernels import normal_equations as summed

    n, K = len(tracks), rig.left.K
    numbers = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], rig.fB_px_m, rig.doffs_px)
    H, b, weights = np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS), np.empty(n)
    columns = (*tracks.uv_from.T, tracks.d_from, *tracks.uv_to.T, tracks.d_to)
    summed(
        np.ascontiguousarray(T_to_from),
        np.stack(columns),
        np.ascontiguousarray(np.broadcast_to(offset_px, (2, n)), np.float64),
        np.array([*numbers, LEAST_PX, NEAREST_M]),
        np.array([sigma_px, KERNEL_SIGMA, 2.0 if forgetting else 1.0]),
        H,
        b,
        weights,
    )
    return NormalEquations(H, b, weights)


@dataclass(frozen=True, eq=False)
class RelativePose:
    """How the left camera moved between two pairs.

    Args:
        T_to_from: (4, 4) maps points of the first left camera to the second one, metres.
        information: (6, 6) inverse covariance of a twist on its left, as the tracks alone tell:
            their errors are not independent, so it is too sure by about a factor of 10.
        tracks: what it rests on.
        weights: (N,) 0-1, how far each track agrees.
    """

    T_to_from: Float64
    information: Float64
    tracks: PointTracks
    weights: Float64

    @property
    def distance_m(self) -> float:
        """How far the camera moved."""
        return float(np.linalg.norm(self.T_to_from[:3, 3]))


def first_pose(
    tracks: PointTracks, rig: StereoRig, *, within_px: float = RANSAC_INLIER_PX
) -> Float64 | None:
    """(4, 4) `T_to_from` that most tracks agree on to `within_px`, or None; robust, not precise.

    Source: P3P in RANSAC (Fischler & Bolles 1981), of OpenCV, whose random numbers are fixed.
    """
    import cv2

    if len(tracks) < MIN_POINTS:
        return None
    points = points_by_q(tracks.d_from, tracks.uv_from[:, 0], tracks.uv_from[:, 1], rig)
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points,
        tracks.uv_to,
        rig.left.K,
        np.zeros(4),
        iterationsCount=RANSAC_TRIES,
        reprojectionError=within_px,
        confidence=RANSAC_CONFIDENCE,
        flags=cv2.SOLVEPNP_P3P,
    )
    if not found or inliers is None or len(inliers) < MIN_POINTS:
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], translation[:, 0]
    return T


def refined_pose(
    T_to_from: Float64,
    tracks: PointTracks,
    rig: StereoRig,
    *,
    offset_px: Float64 | float = 0.0,
    sigma_px: float = TRACK_SIGMA_PX,
) -> RelativePose | None:
    """The most likely pose near `T_to_from`; None where too few tracks agree on one.

    Weighted Gauss-Newton on (u, v, d) of the second pair, with the error that the first pair's
    disparity brings into the prediction.

    Args:
        T_to_from: (4, 4) a pose nearby.
        tracks: measured.
        rig: rectified.
        offset_px: as in `linearised`.
        sigma_px: error of a point in each of u, v and d.
    """
    if len(tracks) < MIN_POINTS:
        return None
    T = T_to_from
    for iteration in range(MAX_ITERATIONS):
        at = normal_equations(
            T,
            tracks,
            rig,
            offset_px=offset_px,
            sigma_px=sigma_px,
            forgetting=iteration >= CAUCHY_ITERATIONS,
        )
        H, weights = at.H[:6, :6], at.weights
        if weights.sum() < MIN_POINTS or np.linalg.cond(H) > 1 / np.finfo(float).eps:
            return None
        step = np.asarray(np.linalg.solve(H, at.b[:6]))
        T = exp_twist(step) @ T
        if np.linalg.norm(step) < CONVERGED and iteration >= CAUCHY_ITERATIONS:
            break
    return RelativePose(T, H, tracks, weights)
