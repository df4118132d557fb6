"""Standard deviations of a calibration, and the depth error that follows from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.solving.bundle import POSE, steps_without
from pseudolidar.calibration.solving.lens_terms import INTRINSICS, parameters, project
from pseudolidar.calibration.solving.robust import Cauchy
from pseudolidar.calibration.solving.solve import Solution
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import rectification
from pseudolidar.geometry.twists import skew
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.quality import CameraSigma

# Depths that the expected error is told for, m, and the points of the picture that it is of.
DEPTHS_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
GRID = (7, 5)
# Points within this share of the rectified picture: its outermost edge is extrapolated.
WITHIN = 0.8
# What is told by less than this share of what is told best is not told, but for rounding.
LEAST_TOLD = 1e-12


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How sure a calibration is.

    Args:
        covariance: (S, S) of the cameras' vectors and the twist of the pose between them.
        left: standard deviations of the left camera.
        right: of the right one.
        rotation_rad: (3,) of the rotation between them.
        translation_m: (3,) of their translation.
        baseline_m: of their distance.
        depth_m: (M, 2) depths and the standard deviation that the calibration gives them.
    """

    covariance: Float64
    left: CameraSigma
    right: CameraSigma
    rotation_rad: Float64
    translation_m: Float64
    baseline_m: float
    depth_m: Float64


def uncertainty(solution: Solution) -> Uncertainty:
    """Standard deviations from the Jacobian, with errors that the corners of a view share.

    Corners of one view err together (a board that moved, light, a bent board), so that views count
    more than corners: how much more intrinsics, distortion, rotation and translation are unsure
    than from independent corners follows from how they change without each of the views. Of few
    views only the size of these changes is taken, their shape is the Jacobian's.

    Source: Cameron and Miller, A practitioner's guide to cluster-robust inference, 2015, the
    jackknife of section VI.B (CR3). Weights by residuals: Huber and Ronchetti, Robust Statistics,
    2009, eq. 7.81.
    """
    fit, seen = solution.fit, solution.blocks.seen
    # With a residual also its weight changes: of Cauchy's, corners then count by their weight once
    # more.
    counted = float((fit.weights * Cauchy()(fit.residuals, seen)).sum() / fit.weights.sum())
    inverse, views = _inverse(counted * fit.normal.reduced()), len(solution.blocks)
    degrees = 2 * float(seen.sum()) - len(inverse) - POSE * views
    pulled = (fit.weights**2 * (fit.residuals**2).sum(axis=-1)).sum() / fit.weights.sum()
    variance = float(pulled) * float(seen.sum()) / max(degrees, 1.0)
    independent = inverse * (variance / counted)
    changes = steps_without(solution.blocks, fit) / counted
    jackknife = (views - 1) / views * (changes**2).sum(axis=0)
    ratios = jackknife / np.maximum(np.diag(independent), np.finfo(float).tiny)
    grown = np.empty(len(inverse))
    for part in _alike(parameters(solution.model)):
        grown[part] = np.sqrt(max(1.0, float(np.mean(ratios[part]))))
    covariance = independent * grown * grown[:, None]
    return _told(solution, covariance)


def _alike(n: int) -> list[slice]:
    """Unknowns that are of a kind: of two cameras with n each, and of the pose between them."""
    cameras = [
        slice(eye * n + begin, eye * n + end)
        for eye in range(2)
        for begin, end in ((0, INTRINSICS), (INTRINSICS, n))
    ]
    return [*cameras, slice(2 * n, 2 * n + 3), slice(2 * n + 3, None)]


def _inverse(information: Float64) -> Float64:
    """The covariance; what nothing tells (boards that were never tilted) gets a large one."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information * unit * unit[:, None])
    inverse = (vectors / np.maximum(values, LEAST_TOLD * values[-1])) @ vectors.T
    return np.asarray(inverse * unit * unit[:, None])


def _told(solution: Solution, covariance: Float64) -> Uncertainty:
    n = parameters(solution.model)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    cameras = [
        CameraSigma(part[:INTRINSICS].copy(), part[INTRINSICS:].copy())
        for part in (sigma[:n], sigma[n : 2 * n])
    ]
    twist = covariance[2 * n :, 2 * n :]
    t_m = solution.fit.state.T_eye_first[1, :3, 3]
    by_twist = np.hstack([np.eye(3), -skew(t_m)])
    translation = by_twist @ twist @ by_twist.T
    along = t_m / np.linalg.norm(t_m)
    depths = np.array([[z, _depth_sigma(solution, covariance, z)] for z in DEPTHS_M])
    return Uncertainty(
        covariance,
        cameras[0],
        cameras[1],
        sigma[2 * n + 3 :].copy(),
        np.sqrt(np.maximum(np.diag(translation), 0.0)),
        float(np.sqrt(max(float(along @ twist[:3, :3] @ along), 0.0))),
        depths[np.isfinite(depths).all(axis=1)],
    )


def _depth_sigma(solution: Solution, covariance: Float64, depth_m: float) -> float:
    """Root mean square over the picture of the depth's standard deviation at a depth, m.

    A point is where it is seen at best: its pixels stay, the cameras change, and it moves by
    `-(J^T J)^-1 J^T J_cameras`.
    """
    state, rig = solution.fit.state, solution.rig
    plan = rectification(rig)
    width, height = plan.rig.left.size_px
    across, down = (np.linspace(0.5 - WITHIN / 2, 0.5 + WITHIN / 2, n) for n in GRID)
    u, v = np.meshgrid(across, down)
    pixels = np.stack([u * (width - 1), v * (height - 1)], axis=-1).reshape(-1, 2)
    flat = Lens.of(plan.rig.left).directions(pixels)
    points = (flat * (depth_m / flat[:, 2:])) @ plan.R_left
    n, size = parameters(state.model), len(covariance)
    R, t_m = state.T_eye_first[1, :3, :3], state.T_eye_first[1, :3, 3]
    in_right = points @ R.T + t_m
    _, by_left, by_left_camera = project(state.model, state.cameras[0], points)
    _, by_right, by_right_camera = project(state.model, state.cameras[1], in_right)
    by_point = np.concatenate([by_left, by_right @ R], axis=1)
    by_cameras = np.zeros((len(points), 4, size))
    by_cameras[:, :2, :n] = by_left_camera
    by_cameras[:, 2:, n : 2 * n] = by_right_camera
    by_cameras[:, 2:, 2 * n :] = np.concatenate([by_right, -by_right @ skew(in_right)], axis=-1)
    moved = -np.linalg.pinv(by_point) @ by_cameras
    along = np.einsum("i,pis->ps", plan.R_left[2], moved)
    variance = np.einsum("ps,st,pt->p", along, covariance, along)
    return float(np.sqrt(np.mean(variance)))
