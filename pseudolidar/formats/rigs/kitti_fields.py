"""Values of KITTI's calibration files: transforms that must be rigid, sizes that must be whole."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pseudolidar.errors import CalibrationValue
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.rigs.key_values import KeyValues, read_key_values
from pseudolidar.formats.rigs.kitti_calibration import FRAME_CAM0, WHICH_LAYOUT
from pseudolidar.formats.rigs.rig_parts import FARTHEST_SENSOR_M
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import ROTATION_TOLERANCE, Pose, rotation_error, rotation_fault

# KITTI writes 7 digits, so that a product of two of its rotations is off by some 1e-6.
ROTATION_NOTED = 1e-5
RIGID_COUNTS = {"R": 9, "T": 3, r"delta_[fc]": 2}


def rigid_file(path: Path, dst: str, src: str, notes: list[str], limits: Limits) -> Pose:
    """The transform in one of the raw data's files of R and T.

    Args:
        path: the file.
        dst: frame that the transform leads to.
        src: frame that it comes from.
        notes: gets a line where the rotation is one only roughly.
        limits: cap on the file.

    Raises:
        CalibrationMissing, CalibrationField, CalibrationSyntax: as they say.
        CalibrationValue: no rotation, or a sensor that is further away than any car is long.
    """
    fields = read_key_values(path, RIGID_COUNTS, hint=WHICH_LAYOUT, limits=limits)
    R, t_m = fields.require("R").reshape(3, 3), fields.require("T")
    check_rotation(fields, "R", R, notes)
    return _near(Pose.from_rotation(dst, src, R, t_m), fields, "T")


def rigid_row(fields: KeyValues, key: str, dst: str, src: str, notes: list[str]) -> Pose:
    """The transform under a key of twelve numbers. Args and errors as `rigid_file`."""
    matrix = fields.require(key).reshape(3, 4)
    check_rotation(fields, key, matrix[:, :3], notes)
    return _near(Pose.from_rotation(dst, src, matrix[:, :3], matrix[:, 3]), fields, key)


def rectifying_pose(fields: KeyValues, key: str, notes: list[str]) -> Pose:
    """The rotation of camera 0 into its rectified frame. Errors as `check_rotation`."""
    R = fields.require(key).reshape(3, 3)
    check_rotation(fields, key, R, notes)
    return Pose.from_rotation(FRAME_CAM0, FRAME_CAM0, R, np.zeros(3))


def check_rotation(fields: KeyValues, key: str, R: Float64, notes: list[str]) -> None:
    """Raise `CalibrationValue` unless `R` is a rotation; note it where it is one only roughly.

    Args:
        fields: of the file, for its place in errors.
        key: of the rotation.
        R: (3, 3).
        notes: gets the line.
    """
    error = rotation_error(R)
    if not error <= ROTATION_TOLERANCE:
        raise CalibrationValue(
            f"{key} is no rotation: {rotation_fault(R)}",
            want=f"orthonormal to {ROTATION_TOLERANCE:g}, determinant 1",
            path=fields.path,
            where=f"{key}, line {fields.lines[key]}",
        )
    if error > ROTATION_NOTED:
        notes.append(f"warning: {fields.path.name}: {key} is a rotation only to {error:.1g}")


def _near(pose: Pose, fields: KeyValues, key: str) -> Pose:
    distance_m = math.hypot(*pose.translation_m)
    if distance_m > FARTHEST_SENSOR_M:
        raise CalibrationValue(
            f"{pose.src} {distance_m:g} m from {pose.dst}",
            want=f"at most {FARTHEST_SENSOR_M:g} m",
            fix="Is it in millimetres? Write metres.",
            path=fields.path,
            where=f"{key}, line {fields.lines[key]}",
        )
    return pose


def size_px(fields: KeyValues, key: str) -> tuple[int, int]:
    """(width, height) under a key.

    Raises:
        CalibrationField: the key is missing.
        CalibrationValue: no whole numbers of pixels.
    """
    width, height = (float(side) for side in fields.require(key))
    if not (width == int(width) >= 1 and height == int(height) >= 1):
        raise CalibrationValue(
            f"pictures of {width:g}x{height:g}",
            want="whole numbers of pixels, 1 or more",
            path=fields.path,
            where=f"{key}, line {fields.lines[key]}",
        )
    return int(width), int(height)
