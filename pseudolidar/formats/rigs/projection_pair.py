"""A rig out of nothing but two projection matrices; what is inconsistent about them is named."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pseudolidar.errors import CalibrationField, CalibrationValue
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import at_place
from pseudolidar.formats.rigs.projection_text import NamedMatrix, read_projections
from pseudolidar.formats.rigs.rig_parts import LEFT, RIGHT
from pseudolidar.formats.rigs.rig_reading import RigReading, RigUnit, checked_order, in_metres
from pseudolidar.geometry.decomposition import Decomposition, decompose
from pseudolidar.geometry.unrectified import rotation_deg, side_word, why_unrectified
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

FORM = "two projection matrices"
# What matrices of seven digits agree to: elements of rotations, skew as a share of fx.
ROUNDED = 1e-6
# Flat pictures, which these are, have nothing in common when they face further apart.
MOST_APART_DEG = 90.0


def read_projection_pair(
    files: Sequence[Path],
    *,
    size_px: tuple[int, int] | None,
    unit: RigUnit | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> RigReading:
    """Read the projection matrices of a pair: one file with both, or one a file, the left first.

    Args:
        files: one or two.
        size_px: (width, height) of the pictures, which no such file says.
        unit: of lengths, where metres are not meant.
        limits: cap on the files.

    Raises:
        CalibrationMissing, CalibrationSyntax, LimitError: as `read_projections`.
        CalibrationField: not two matrices, or nobody knows the size of the pictures.
        CalibrationValue: no camera; cameras above or behind each other; exchanged eyes; the same
            matrix twice.
        CalibrationUnits: lengths that are no metres, and `unit` is not given.
    """
    matrices = [matrix for file in files for matrix in read_projections(file, limits=limits)]
    if len(matrices) != 2:
        raise CalibrationField(
            f"{len(matrices)} projection matrices",
            want="two: of the left camera and of the right one",
            fix="Give both files with a comma between them: LEFT,RIGHT.",
            path=files[0],
            where=matrices[0].where if matrices else "line 1",
        )
    left, right = _by_name(matrices)
    if size_px is None:
        raise CalibrationField(
            "no image size", want="pictures beside the file, which have one", path=left.path
        )
    return projection_reading(left, right, size_px=size_px, unit=unit)


def _by_name(matrices: list[NamedMatrix]) -> tuple[NamedMatrix, NamedMatrix]:
    """Left and right by their names, else in the order that they are given in."""
    first, second = matrices
    exchanged = "right" in first.name.lower() and "left" in second.name.lower()
    return (second, first) if exchanged else (first, second)


def projection_reading(
    left: NamedMatrix, right: NamedMatrix, *, size_px: tuple[int, int], unit: RigUnit | None
) -> RigReading:
    """The rig of two projection matrices of one world. Raises as `read_projection_pair`."""
    parts = [_decomposed(matrix) for matrix in (left, right)]
    R, t = _between(*parts)
    if not np.linalg.norm(t) > 0:
        raise CalibrationValue(
            "both matrices put the camera at one place: baseline 0",
            want="two cameras apart",
            fix="Give the matrices of the left and of the right camera, of one world.",
            path=right.path,
            where=right.where,
        )
    pose = Pose.from_rotation(RIGHT, LEFT, R, t)
    _check_facing(right, R)
    _check_direction(left, right, parts, pose)
    checked_order(pose, path=right.path, where=right.where)
    t_m = in_metres(t, unit, path=right.path, where=right.where)
    rig = StereoRig(
        _camera(left, parts[0], size_px, LEFT),
        _camera(right, parts[1], size_px, RIGHT),
        Pose.from_rotation(RIGHT, LEFT, R, t_m),
        origin=left.path.name,
    )
    notes = [f"{left.path.name}: {FORM}, taken apart into K, R and t; no lens distortion is known"]
    notes += [f"warning: {left.path.name}: {reason}" for reason in why_unrectified(rig)]
    names = [matrix.name or eye for matrix, eye in ((left, "P_left"), (right, "P_right"))]
    return RigReading(
        left.path,
        FORM,
        rig if rig.is_rectified else None,
        rig,
        tuple(notes),
        projections=dict(zip(names, (left.P, right.P), strict=True)),
    )


def _decomposed(matrix: NamedMatrix) -> Decomposition:
    try:
        return decompose(matrix.P)
    except CalibrationValue as error:
        raise error.located(matrix.path, matrix.where) from None


def _between(left: Decomposition, right: Decomposition) -> tuple[Float64, Float64]:
    """Rotation and translation of the left camera's frame to the right one's.

    Of cameras that look the same way to the digits that matrices have, R is the identity and t the
    difference of theirs.
    """
    R = right.R @ left.R.T
    if np.abs(R - np.eye(3)).max() < ROUNDED:
        return np.eye(3), right.t - left.t
    return R, right.t - R @ left.t


def _check_facing(right: NamedMatrix, R: Float64) -> None:
    apart_deg = rotation_deg(R)
    if apart_deg > MOST_APART_DEG:
        raise CalibrationValue(
            f"cameras that look {apart_deg:.0f} degrees apart",
            want="two cameras that see the same things",
            fix="Does one of the matrices have a negative focal length, or is it of another world?",
            path=right.path,
            where=right.where,
        )


def _check_direction(
    left: NamedMatrix, right: NamedMatrix, parts: list[Decomposition], pose: Pose
) -> None:
    """Refuse cameras above or behind each other, with the number that would be one beside.

    Raises:
        CalibrationValue: the largest part of the baseline is not along the rows of the left camera.
    """
    place = pose.inverse().translation_m
    axis = int(np.argmax(np.abs(place)))
    if axis == 0:
        return
    side = side_word(axis, float(place[axis]))
    baseline = float(np.linalg.norm(place))
    told = ", ".join(f"{x:.6g}" for x in place)
    raise CalibrationValue(
        f"the right camera stands {abs(place[axis]):.6g} {side} the left one: baseline ({told})"
        + _differing(left, right),
        want="a baseline along x, the direction of the rows: cameras side by side",
        fix=_beside(left, right, parts, baseline),
        path=right.path,
        where=right.where,
    )


def _differing(left: NamedMatrix, right: NamedMatrix) -> str:
    """Which numbers of the matrices differ, where that is a single one."""
    differs = np.argwhere(left.P != right.P)
    if len(differs) != 1:
        return ""
    row, column = differs[0]
    return (
        f"; the matrices differ in row {row + 1}, column {column + 1} alone, "
        f"{left.P[row, column]:g} and {right.P[row, column]:g}"
    )


def _beside(
    left: NamedMatrix, right: NamedMatrix, parts: list[Decomposition], baseline: float
) -> str:
    """What to do about it; of matrices with one left part, with the number that would be right."""
    if not np.array_equal(left.P[:, :3], right.P[:, :3]):
        return "Check which axis is meant; pictures that are shifted along columns must be turned."
    moved = left.P[0, 3] - parts[0].scale * parts[0].K[0, 0] * baseline
    return (
        "If the pictures are shifted along their rows, the difference belongs into row 1: "
        f"{moved:g} in place of {right.P[0, 3]:g} in column 4 of {right.name or 'the second'}. "
        "If along their columns, turn pictures and cameras by 90 degrees."
    )


def _camera(
    matrix: NamedMatrix, part: Decomposition, size_px: tuple[int, int], frame: str
) -> Camera:
    K = part.K.copy()
    if abs(K[0, 1]) < ROUNDED * K[0, 0]:
        K[0, 1] = 0.0  # of the rounding of P
    try:
        return Camera(K, *size_px, frame=frame)
    except CalibrationValue as error:
        raise at_place(error, path=matrix.path, where=matrix.where) from None
