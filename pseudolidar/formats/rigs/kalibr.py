"""Kalibr's camchain YAML; read_x beside write_x.

Each camera has the pose of the one before it, `T_cn_cnm1`: points of camera n-1 to camera n.
Source: Kalibr's wiki, "YAML formats" and "Supported models".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationValue,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_fields import at_node
from pseudolidar.formats.rigs.rig_parts import LEFT, RIGHT
from pseudolidar.formats.rigs.rig_reading import (
    RigReading,
    RigUnit,
    checked_order,
    in_metres,
    pose_right_left,
)
from pseudolidar.formats.rigs.storage import matrix_of, read_storage
from pseudolidar.geometry.unrectified import why_unrectified
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, LensModel, StereoRig
from pseudolidar.structures.pose import Pose

FORM = "Kalibr camchain"
_CAMERA = re.compile(r"cam([0-9]+)")
_MARKS = ("camera_model", "distortion_model", "T_cn_cnm1")
# Kalibr's lens models that OpenCV's have the formula of, and how many numbers they have.
_LENSES: Mapping[str, tuple[LensModel, int]] = {
    "radtan": ("pinhole", 4),
    "equidistant": ("fisheye", 4),
    "equi": ("fisheye", 4),
    "none": ("pinhole", 0),
}
_KALIBR_LENSES: Mapping[LensModel, str] = {"pinhole": "radtan", "fisheye": "equidistant"}


@dataclass(frozen=True, eq=False)
class ChainedCamera:
    """A camera of the chain.

    Args:
        name: such as `cam0`.
        camera: with its distortion.
        T_camera_previous: pose of the camera before it, in the unit of the file; None of the first.
        node: where it stands in the file.
        pose_where: where its pose stands.
    """

    name: str
    camera: Camera
    T_camera_previous: Pose | None
    node: Node
    pose_where: str = ""


def is_camchain(node: Node) -> bool:
    """Whether a tree of values is a camchain: mappings cam0, cam1 with Kalibr's fields."""
    if not isinstance(node.value, dict):
        return False
    return any(
        _CAMERA.fullmatch(name)
        and isinstance(camera.value, dict)
        and any(mark in camera.value for mark in _MARKS)
        for name, camera in node.value.items()
    )


def read_camchain(
    path: Path, *, unit: RigUnit | None = None, limits: Limits = DEFAULT_LIMITS
) -> RigReading:
    """Read the first two cameras of a camchain as a rig.

    Args:
        path: the file.
        unit: of lengths, where metres are not meant.
        limits: cap on its size.

    Raises:
        CalibrationMissing, CalibrationSyntax, LimitError: as `read_storage`.
        CalibrationField: no second camera, or a camera lacks a field.
        CalibrationValue: a lens model that is not known here, a T_cn_cnm1 that is not rigid,
            exchanged eyes, an impossible camera.
        CalibrationUnits: lengths that are no metres, and `unit` is not given.
    """
    chain = read_chain(path, limits=limits)
    if len(chain) < 2:
        raise CalibrationField(
            "one camera alone, cam0",
            want="cam1 with T_cn_cnm1",
            fix="Calibrate both cameras in one run of Kalibr.",
            path=path,
        )
    left, right = chain[:2]
    assert right.T_camera_previous is not None
    pose = checked_order(right.T_camera_previous, path=path, where=right.pose_where)
    t_m = in_metres(pose.translation_m, unit, path=path, where=right.pose_where)
    try:
        rig = StereoRig(
            left.camera,
            right.camera,
            Pose.from_rotation(RIGHT, LEFT, pose.matrix[:3, :3], t_m),
            origin=path.name,
        )
    except PseudolidarError as error:
        raise error.located(path) from None
    more = ", ".join(each.name for each in chain[2:])
    notes = [f"{path.name}: {left.name} is the left camera, {right.name} the right one"]
    notes += [f"{path.name}: {more} left aside"] if more else []
    if "T_cam_imu" in _fields(left.node):
        notes.append(f"{path.name}: T_cam_imu left aside")
    rectified = None if why_unrectified(rig) else rig
    return RigReading(path, FORM, rectified, rig, tuple(notes))


def read_chain(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[ChainedCamera, ...]:
    """All cameras of a camchain, in the order of their numbers. Raises as `read_camchain`."""
    documents = read_storage(path, limits=limits)
    fields = _fields(documents[0])
    numbers = sorted(int(m[1]) for name in fields if (m := _CAMERA.fullmatch(name)))
    if len(documents) > 1 or not numbers or numbers != list(range(len(numbers))):
        found = ", ".join(list(fields)[:20]) or "nothing"
        raise CalibrationField(f"found {found}", want="cam0, cam1, ... in one document", path=path)
    frames = [LEFT, RIGHT, *(f"cam{number}" for number in numbers[2:])]
    return tuple(
        _chained(fields[f"cam{number}"], f"cam{number}", frames, number) for number in numbers
    )


def _fields(node: Node) -> dict[str, Node]:
    if not isinstance(node.value, dict):
        raise _syntax(node, "no mapping", "KEY: value")
    return node.value


def _chained(node: Node, name: str, frames: list[str], number: int) -> ChainedCamera:
    camera = _camera(node, name, frames[number])
    if number == 0:
        return ChainedCamera(name, camera, None, node)
    held = _required(node, name, "T_cn_cnm1")
    T = _matrix(held, 16).reshape(4, 4)
    if not np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise CalibrationValue(
            f"T_cn_cnm1 with last row {T[3].tolist()}",
            want="[0, 0, 0, 1]",
            path=held.path,
            where=held.where,
        )
    checked = pose_right_left(T[:3, :3], T[:3, 3], path=Path(held.path), where=held.where)
    pose = Pose(frames[number], frames[number - 1], checked.matrix)
    return ChainedCamera(name, camera, pose, node, held.where)


def _camera(node: Node, name: str, frame: str) -> Camera:
    projection = _word(node, name, "camera_model")
    if projection != "pinhole":
        raise _unknown_model(_required(node, name, "camera_model"), f"camera_model {projection!r}")
    lens = _word(node, name, "distortion_model")
    if lens not in _LENSES:
        raise _unknown_model(_required(node, name, "distortion_model"), f"distortion {lens!r}")
    model, count = _LENSES[lens]
    distortion = (
        _matrix(_required(node, name, "distortion_coeffs"), count) if count else np.zeros(0)
    )
    intrinsics = _required(node, name, "intrinsics")
    fx, fy, cx, cy = _matrix(intrinsics, 4)
    width, height = _size(_required(node, name, "resolution"))
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    try:
        return Camera(K, width, height, distortion, model, frame)
    except CalibrationValue as error:
        bent = error.where.endswith("distortion")
        place = _required(node, name, "distortion_coeffs") if bent else intrinsics
        raise at_node(error, place) from None


def _required(node: Node, name: str, key: str) -> Node:
    fields = _fields(node)
    if key not in fields:
        raise CalibrationField(
            f"{name} has no {key}; found {', '.join(fields) or 'nothing'}",
            want=key,
            fix="Is this the camchain that Kalibr wrote?",
            path=node.path,
            where=node.where,
        )
    return fields[key]


def _word(node: Node, name: str, key: str) -> str:
    held = _required(node, name, key)
    if not isinstance(held.value, str):
        raise _syntax(held, f"{held.value!r}"[:40], "the name of a model")
    return held.value


def _unknown_model(node: Node, got: str) -> CalibrationValue:
    return CalibrationValue(
        got,
        want="camera_model pinhole with distortion_model radtan, equidistant or none",
        fix="Calibrate with pinhole-radtan or pinhole-equi.",
        path=node.path,
        where=node.where,
    )


def _matrix(node: Node, count: int) -> Float64:
    """(count,) numbers of a list or of a list of rows."""
    found = matrix_of(node).ravel()
    if len(found) != count:
        raise _syntax(node, f"{len(found)} numbers", str(count))
    return found


def _size(node: Node) -> tuple[int, int]:
    sides = [side.value for side in node.value] if isinstance(node.value, tuple) else []
    whole = [side for side in sides if isinstance(side, int) and not isinstance(side, bool)]
    if len(sides) != 2 or len(whole) != 2 or min(whole) < 1:
        raise _syntax(node, "no picture size", "[width, height], whole numbers of pixels")
    return whole[0], whole[1]


def _syntax(node: Node, got: str, want: str) -> CalibrationSyntax:
    return CalibrationSyntax(got, want=want, path=node.path, where=node.where)


# --- writing -------------------------------------------------------------------------------------


def write_camchain(path: Path, rig: StereoRig) -> None:
    """Write the two cameras of a rig as they are, with all digits.

    Raises:
        StructureError: a lens with more numbers than Kalibr's radtan has.
        OutputError: the file cannot be written.
    """
    write_atomic(path, camchain_text(rig).encode())


def camchain_text(rig: StereoRig) -> str:
    """The text of a camchain. Raises as `write_camchain`."""
    T = rig.T_right_left.matrix
    rows = "\n".join(f"  - {_listed(row)}" for row in T)
    left, right = _camera_text(rig.left, 0), _camera_text(rig.right, 1)
    return f"cam0:\n{left}cam1:\n  T_cn_cnm1:\n{rows}\n{right}"


def _camera_text(camera: Camera, number: int) -> str:
    K = camera.K
    if K[0, 1] != 0:
        raise StructureError(
            f"a camera with skew {K[0, 1]:g} px", want="none: Kalibr has no skew", where=FORM
        )
    lines = [
        f"cam_overlaps: [{1 - number}]",
        "camera_model: pinhole",
        f"distortion_coeffs: {_listed(_coefficients(camera))}",
        f"distortion_model: {_KALIBR_LENSES[camera.model]}",
        f"intrinsics: {_listed(np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]))}",
        f"resolution: [{camera.width_px}, {camera.height_px}]",
        f"rostopic: /cam{number}/image_raw",
    ]
    return "".join(f"  {line}\n" for line in lines)


def _coefficients(camera: Camera) -> Float64:
    numbers = np.zeros(4)
    numbers[: len(camera.distortion[:4])] = camera.distortion[:4]
    if camera.distortion[4:].any():
        raise StructureError(
            f"a lens with {len(camera.distortion)} distortion numbers",
            want="4: k1 k2 p1 p2 of Kalibr's radtan",
            fix="Write rig.json, OpenCV's YAML or ROS's camera_info, or calibrate with 4 numbers.",
            where=FORM,
        )
    return numbers


def _listed(values: Float64) -> str:
    return "[" + ", ".join(repr(float(x)) for x in values) + "]"
