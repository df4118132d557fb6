"""A rig with the turn of its right eye put right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pseudolidar.calibration.drift import NAMES, EyeRotation
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import UNREFINED_SIGMA_PX, StereoRig
from pseudolidar.structures.correction import DisparityCorrection, RowCorrection
from pseudolidar.structures.pose import Pose

# Places of the picture, across and down, and disparities (shares of the width) at which
# corrections are laid through what a turn does.
PLACES, DISPARITY_SHARES = (25, 15), (0.0, 0.02, 0.05, 0.1)
# Disparities that a turn changes by less are left alone, px.
LEAST_PX = 0.05


def remounted_rig(rig: StereoRig, R_right: Float64, rotation: EyeRotation) -> StereoRig:
    """The rig of unrectified cameras, its right one mounted as it is seen to be.

    Args:
        rig: the cameras as they are said to be mounted.
        R_right: (3, 3) turns directions in the right camera into those of its rectified picture.
        rotation: seen in rectified pictures.
    """
    turn = R_right.T @ _matrix(rotation.believed_rad) @ R_right
    moved = np.eye(4)
    moved[:3, :3] = turn
    pose = rig.T_right_left
    return replace(
        rig,
        T_right_left=Pose(pose.dst, pose.src, moved @ pose.matrix),
        origin=_origin(rig, rotation),
    )


def realigned_rig(rig: StereoRig, rotation: EyeRotation) -> StereoRig:
    """The rig of rectified pictures, with corrections of rows and disparities for the turn.

    The left picture stays as it is, and with it what is known by its pixels. A correction that the
    rig has is added to. One of the disparities that was fitted without one of the rows holds what
    the turn does to them already: it is left as it is.

    Args:
        rig: rectified rig, as its source has it.
        rotation: seen in its pictures, with rows aligned where the rig says so.
    """
    lower_px, disparity_px, places = _effects(rig, rotation.believed_rad)
    u_right, u_left, v, d = places
    size_px = rig.left.size_px
    rows = _fitted(RowCorrection.features(u_right, v, size_px), lower_px)
    residual_px = rotation.after_px
    if rig.rows is not None:
        rows, residual_px = rows + rig.rows.coefficients, max(residual_px, rig.rows.residual_px)
    said = _said(rotation)
    corrected = replace(
        rig, rows=RowCorrection(rows, residual_px, said), origin=_origin(rig, rotation)
    )
    if np.abs(disparity_px).max() < LEAST_PX or (rig.correction and not rig.rows):
        return corrected
    moved = _fitted(DisparityCorrection.features(d, u_left, v, size_px), disparity_px)
    if rig.correction is None:
        return replace(corrected, correction=DisparityCorrection(moved, UNREFINED_SIGMA_PX, said))
    old = rig.correction
    origin = f"{old.origin}; {said}" if old.origin else said
    added = replace(old, coefficients=old.coefficients + moved, origin=origin)
    return replace(corrected, correction=added)


def _effects(
    rig: StereoRig, turn_rad: Float64
) -> tuple[Float64, Float64, tuple[Float64, Float64, Float64, Float64]]:
    """What a turn does to matches all over the picture.

    Returns:
        (N,) px by which the right picture shows points lower; (N,) px by which their disparities
        are too large; and their column in the right picture as it shows them, their column and row
        in the left one, and their disparity as it is seen.
    """
    width, height = rig.left.size_px
    across, down = np.linspace(0, width - 1, PLACES[0]), np.linspace(0, height - 1, PLACES[1])
    u, v, share = (grid.ravel() for grid in np.meshgrid(across, down, DISPARITY_SHARES))
    true_px = share * width
    K = rig.right.K
    ideal = np.stack([u - true_px, v, np.ones_like(u)], axis=1)
    seen = ideal @ (K @ _matrix(turn_rad) @ np.linalg.inv(K)).T
    seen = seen[:, :2] / seen[:, 2:]
    # Rows are aligned first, which leaves columns as they are.
    d = u - seen[:, 0]
    return seen[:, 1] - v, d - true_px, (seen[:, 0], u, v, d)


def _fitted(features: Float64, values: Float64) -> Float64:
    return np.asarray(np.linalg.lstsq(features, values, rcond=None)[0], np.float64)


def _matrix(turn_rad: Float64) -> Float64:
    return exp_twist(np.concatenate([np.zeros(3), turn_rad]))[:3, :3]


def _said(rotation: EyeRotation) -> str:
    turns = zip(NAMES, np.degrees(rotation.believed_rad), rotation.believed, strict=True)
    seen = ", ".join(f"{name} {angle:+.3f}" for name, angle, there in turns if there)
    return f"right eye turned, {seen} degrees, seen in {rotation.pairs} pairs"


def _origin(rig: StereoRig, rotation: EyeRotation) -> str:
    return f"{rig.origin or 'the rig of the source'}; {_said(rotation)}"
