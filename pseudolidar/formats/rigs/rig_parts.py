"""Cameras, poses and correction of a rig file.

Errors are those of `rig_fields`, and `CalibrationValue` for what no camera or rig can have.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, cast

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationValue,
    StructureError,
)
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_fields import (
    at_node,
    count,
    fields_of,
    lacks,
    matrix,
    number,
    numbers,
    text,
    wrong,
)
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import LEFT_FRAME, RIGHT_FRAME, Camera
from pseudolidar.structures.correction import DisparityCorrection, RowCorrection, SigmaScale
from pseudolidar.structures.pose import Pose, rotation_fault

LEFT, RIGHT, VELODYNE, IMU = LEFT_FRAME, RIGHT_FRAME, "velodyne", "imu"
# Numbers of OpenCV's lens models: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1-s4 [tx ty]]]]; fisheye k1-k4.
COEFFICIENTS = {"pinhole": (0, 4, 5, 8, 12, 14), "fisheye": (0, 4)}
# No rig carries its cameras further apart; such a number is in millimetres.
LARGEST_BASELINE_M = 10.0
# No vehicle that carries cameras and another sensor is longer.
FARTHEST_SENSOR_M = 50.0
# More than 6 degrees are no error of a LiDAR's calibration.
LARGEST_PITCH_RAD = 0.1
# So many coefficients corrections had before the last two came.
EARLIER_TERMS = 8
# Cameras this near to each other are at one place.
NOWHERE_M = 1e-9


def check_coefficients(count: int, model: str, node: Node) -> None:
    """Raise `CalibrationSyntax`, with the place of `node`, where no such lens has so many."""
    if count not in COEFFICIENTS[model]:
        allowed = " or ".join(str(n) for n in COEFFICIENTS[model])
        raise CalibrationSyntax(
            f"{count} numbers",
            want=f"{allowed} of a {model} lens",
            path=node.path,
            where=node.where,
        )


def camera(node: Node, size_px: tuple[int, int], frame: str) -> Camera:
    """A camera; `size_px` is its size unless it says another."""
    optional = ("K", "fx", "fy", "cx", "cy", "distortion", "model", "width_px", "height_px")
    fields = fields_of(node, (), optional)
    K = _intrinsics(node, fields)
    model = text(fields["model"]) if "model" in fields else "pinhole"
    if model not in COEFFICIENTS:
        raise CalibrationValue(
            f"lens model {model!r}",
            want=" or ".join(COEFFICIENTS),
            path=node.path,
            where=fields["model"].where,
        )
    distortion = numbers(fields["distortion"]) if "distortion" in fields else np.zeros(0)
    check_coefficients(len(distortion), model, fields.get("distortion", node))
    width, height = (
        count(fields[key]) if key in fields else default
        for key, default in zip(("width_px", "height_px"), size_px, strict=True)
    )
    named = cast("Literal['pinhole', 'fisheye']", model)
    try:
        return Camera(K, width, height, distortion, named, frame)
    except CalibrationValue as error:
        key = "distortion" if error.where.endswith("distortion") else "K"
        raise at_node(error, fields.get(key, node)) from None


def _intrinsics(node: Node, fields: Mapping[str, Node]) -> Float64:
    by_name = [key for key in ("fx", "fy", "cx", "cy") if key in fields]
    if "K" in fields and by_name:
        raise CalibrationField(
            f"both 'K' and {by_name[0]!r}", want="one of them", path=node.path, where=node.where
        )
    if "K" in fields:
        K = matrix(fields["K"])
        if K[1, 0] != 0 or not np.array_equal(K[2], (0, 0, 1)):
            raise CalibrationValue(
                f"a K with rows {K[1].tolist()} and {K[2].tolist()}",
                want="[0, fy, cy] and [0, 0, 1]",
                path=node.path,
                where=fields["K"].where,
            )
        return K
    for key in ("fx", "cx", "cy"):
        if key not in fields:
            raise lacks(node, f"{key!r} (or 'K')")
    fx, cx, cy = (number(fields[key]) for key in ("fx", "cx", "cy"))
    fy = number(fields["fy"]) if "fy" in fields else fx
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)


def T_right_left(root: Node, fields: Mapping[str, Node]) -> Pose:
    """The pose of the cameras to each other, from `baseline_m` or `T_right_left`."""
    given = [key for key in ("baseline_m", "T_right_left") if key in fields]
    if len(given) != 1:
        raise (
            lacks(root, "'baseline_m' or 'T_right_left'")
            if not given
            else CalibrationField(
                "both 'baseline_m' and 'T_right_left'",
                want="one of them",
                path=root.path,
                where=fields["baseline_m"].where,
            )
        )
    if "T_right_left" in fields:
        return _checked_pair(_pose(fields["T_right_left"], RIGHT, LEFT), fields["T_right_left"])
    node = fields["baseline_m"]
    baseline_m = number(node)
    if not baseline_m > 0:
        raise CalibrationValue(
            f"baseline {baseline_m:g} m",
            want="a positive distance, from the left camera to the right one",
            fix="If the images are exchanged, exchange them and keep it positive.",
            path=node.path,
            where=node.where,
        )
    pose = Pose.from_rotation(RIGHT, LEFT, np.eye(3), np.array([-baseline_m, 0.0, 0.0]))
    return _checked_length(pose, node)


def _checked_pair(pose: Pose, node: Node) -> Pose:
    """The pose, if the right camera is neither where the left one is nor left of it."""
    x, y, z = np.abs(place := pose.inverse().translation_m)
    if max(x, y, z) < NOWHERE_M or (place[0] < 0 and x > max(y, z)):
        raise CalibrationValue(
            f"baseline {place[0]:g} m"
            + (": the camera called left stands right of the other" if place.any() else ""),
            want="the right camera right of the left one: t_m[0] below 0",
            fix="If the eyes are exchanged, exchange cameras and pictures.",
            path=node.path,
            where=node.where,
        )
    return _checked_length(pose, node)


def _checked_length(pose: Pose, node: Node, most_m: float = LARGEST_BASELINE_M) -> Pose:
    distance_m = math.hypot(*pose.translation_m)
    if distance_m > most_m:
        cameras = (pose.dst, pose.src) == (RIGHT, LEFT)
        raise CalibrationValue(
            f"{'cameras' if cameras else f'{pose.dst} and {pose.src}'} {distance_m:g} m apart",
            want=f"at most {most_m:g} m",
            fix="Is it in millimetres? Write metres.",
            path=node.path,
            where=node.where,
        )
    return pose


def optional_pose(fields: Mapping[str, Node], key: str, dst: str, src: str) -> Pose | None:
    """`T_dst_src` under `key`, if it is there."""
    if key not in fields:
        return None
    return _checked_length(_pose(fields[key], dst, src), fields[key], FARTHEST_SENSOR_M)


def _pose(node: Node, dst: str, src: str) -> Pose:
    fields = fields_of(node, ("R", "t_m"))
    R, t_m = matrix(fields["R"]), numbers(fields["t_m"], 3)
    try:
        return Pose.from_rotation(dst, src, R, t_m)
    except StructureError:
        raise CalibrationValue(
            f"R is no rotation: {rotation_fault(R)}",
            want="orthonormal rows and determinant 1, to 1e-3",
            path=node.path,
            where=fields["R"].where,
        ) from None


def correction(node: Node) -> DisparityCorrection:
    """The disparity correction."""
    fields = fields_of(
        node, ("coefficients", "residual_px"), ("origin", "sigma_scale", "covariance", "fitted_m")
    )
    nearest_m, farthest_m = numbers(fields["fitted_m"], 2) if "fitted_m" in fields else (0.0, 0.0)
    held = fields["coefficients"].value
    terms = EARLIER_TERMS if isinstance(held, tuple) and len(held) == EARLIER_TERMS else None
    terms = terms or DisparityCorrection.TERMS
    try:
        return DisparityCorrection(
            _all_terms(numbers(fields["coefficients"], terms)),
            number(fields["residual_px"]),
            text(fields["origin"]) if "origin" in fields else "",
            _sigma_scale(fields["sigma_scale"]) if "sigma_scale" in fields else SigmaScale(),
            _all_terms(matrix(fields["covariance"], terms)) if "covariance" in fields else None,
            (float(nearest_m), float(farthest_m)) if "fitted_m" in fields else None,
        )
    except CalibrationValue as error:
        raise at_node(error, fields["residual_px"]) from None


def _all_terms(values: Float64) -> Float64:
    """Coefficients or their covariance with all terms: 0 for those that a file has not."""
    missing = DisparityCorrection.TERMS - len(values)
    return np.pad(values, (0, missing))


def _sigma_scale(node: Node) -> SigmaScale:
    """One factor, or [disparity, factor] of several disparities."""
    if not isinstance(node.value, tuple):
        return SigmaScale.constant(number(node))
    if not node.value:
        raise wrong(node, "a number, or [disparity in px, factor] of several disparities")
    disparities_px, factors = np.stack([numbers(pair, 2) for pair in node.value], axis=1)
    return SigmaScale(disparities_px, factors)


def lidar_pitch(node: Node) -> float:
    """By how much the LiDAR is raised, rad."""
    pitch_rad = number(node)
    if abs(pitch_rad) > LARGEST_PITCH_RAD:
        raise CalibrationValue(
            f"a LiDAR whose calibration is off by {np.rad2deg(pitch_rad):.1f} degrees",
            want=f"{LARGEST_PITCH_RAD:g} rad at most",
            path=node.path,
            where=node.where,
        )
    return pitch_rad


def rows(node: Node) -> RowCorrection:
    """The row correction."""
    fields = fields_of(node, ("coefficients", "residual_px"), ("origin",))
    origin = text(fields["origin"]) if "origin" in fields else ""
    coefficients = numbers(fields["coefficients"], 9)
    try:
        return RowCorrection(coefficients, number(fields["residual_px"]), origin)
    except CalibrationValue as error:
        raise at_node(error, fields["residual_px"]) from None
