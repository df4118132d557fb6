"""A camera as Kalibr's camchain and EuRoC's sensor.yaml have it: four intrinsics, a named lens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pseudolidar.errors import CalibrationField, CalibrationSyntax, CalibrationValue
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_fields import at_node
from pseudolidar.formats.rigs.rig_reading import pose_right_left
from pseudolidar.formats.rigs.storage import matrix_of
from pseudolidar.formats.text import LONGEST_SHOWN
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, LensModel
from pseudolidar.structures.pose import Pose

# Lens models that OpenCV's have the formula of, and how many numbers they have.
_LENSES: Mapping[str, tuple[LensModel, int]] = {
    "radtan": ("pinhole", 4),
    "radial-tangential": ("pinhole", 4),
    "equidistant": ("fisheye", 4),
    "equi": ("fisheye", 4),
    "none": ("pinhole", 0),
}
# The key of the distortion numbers of Kalibr, and of EuRoC.
_COEFFICIENTS = ("distortion_coeffs", "distortion_coefficients")


def camera_of(node: Node, name: str, frame: str) -> Camera:
    """The camera in a mapping.

    Args:
        node: the mapping.
        name: what it is called, for errors.
        frame: of the camera.

    Raises:
        CalibrationField: a key is missing.
        CalibrationSyntax: a value of another form.
        CalibrationValue: a lens model that is not known here, an impossible camera.
    """
    projection = _word(node, name, "camera_model")
    if projection != "pinhole":
        raise _unknown_model(required(node, name, "camera_model"), f"camera_model {projection!r}")
    lens = _word(node, name, "distortion_model").lower().replace("_", "-")
    if lens not in _LENSES:
        raise _unknown_model(required(node, name, "distortion_model"), f"distortion {lens!r}")
    model, count = _LENSES[lens]
    key = next((key for key in _COEFFICIENTS if key in fields_of_mapping(node)), _COEFFICIENTS[0])
    distortion = numbers_of(required(node, name, key), count) if count else np.zeros(0)
    intrinsics = required(node, name, "intrinsics")
    fx, fy, cx, cy = numbers_of(intrinsics, 4)
    width, height = _size(required(node, name, "resolution"))
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    try:
        return Camera(K, width, height, distortion, model, frame)
    except CalibrationValue as error:
        bent = error.where.endswith("distortion")
        raise at_node(error, required(node, name, key) if bent else intrinsics) from None


def pose_of(node: Node, name: str, key: str, dst: str, src: str) -> tuple[Pose, Node]:
    """`T_dst_src` of the 4x4 matrix under a key, in the unit of the file, and where it stands.

    Raises:
        CalibrationField, CalibrationSyntax: it is missing, or no such matrix.
        CalibrationValue: it is not rigid.
    """
    held = required(node, name, key)
    T = numbers_of(held, 16).reshape(4, 4)
    if not np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise CalibrationValue(
            f"{key} with last row {T[3].tolist()}",
            want="[0, 0, 0, 1]",
            path=held.path,
            where=held.where,
        )
    checked = pose_right_left(T[:3, :3], T[:3, 3], path=Path(held.path), where=held.where)
    return Pose(dst, src, checked.matrix), held


def fields_of_mapping(node: Node) -> dict[str, Node]:
    """The values of a mapping by their keys. Raises `CalibrationSyntax` where it is none."""
    if not isinstance(node.value, dict):
        raise _syntax(node, "no mapping", "KEY: value")
    return node.value


def required(node: Node, name: str, key: str) -> Node:
    """The value under a key. Raises `CalibrationField` where it is missing."""
    fields = fields_of_mapping(node)
    if key not in fields:
        raise CalibrationField(
            f"{name} has no {key}; found {', '.join(fields) or 'nothing'}",
            want=key,
            fix="Is this the file that the calibration wrote?",
            path=node.path,
            where=node.where,
        )
    return fields[key]


def numbers_of(node: Node, count: int) -> Float64:
    """(count,) numbers of a list or of a list of rows. Raises `CalibrationSyntax` otherwise."""
    found = matrix_of(node).ravel()
    if len(found) != count:
        raise _syntax(node, f"{len(found)} numbers", str(count))
    return found


def _word(node: Node, name: str, key: str) -> str:
    held = required(node, name, key)
    if not isinstance(held.value, str):
        raise _syntax(held, f"{held.value!r}"[:LONGEST_SHOWN], "the name of a model")
    return held.value


def _unknown_model(node: Node, got: str) -> CalibrationValue:
    return CalibrationValue(
        got,
        want="camera_model pinhole with distortion_model radtan, equidistant or none",
        fix="Calibrate with pinhole-radtan or pinhole-equi.",
        path=node.path,
        where=node.where,
    )


def _size(node: Node) -> tuple[int, int]:
    sides = [side.value for side in node.value] if isinstance(node.value, tuple) else []
    whole = [side for side in sides if isinstance(side, int) and not isinstance(side, bool)]
    if len(sides) != 2 or len(whole) != 2 or min(whole) < 1:
        raise _syntax(node, "no picture size", "[width, height], whole numbers of pixels")
    return whole[0], whole[1]


def _syntax(node: Node, got: str, want: str) -> CalibrationSyntax:
    return CalibrationSyntax(got, want=want, path=node.path, where=node.where)
