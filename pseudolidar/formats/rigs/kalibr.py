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
    StructureError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.named_lens import camera_of, fields_of_mapping, pose_of
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_parts import IMU, LEFT, RIGHT
from pseudolidar.formats.rigs.rig_reading import (
    RigReading,
    RigUnit,
    checked_order,
    in_metres,
)
from pseudolidar.formats.rigs.storage import read_storage
from pseudolidar.geometry.unrectified import why_unrectified
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, LensModel, StereoRig
from pseudolidar.structures.pose import Pose

FORM = "Kalibr camchain"
_CAMERA = re.compile(r"cam([0-9]+)")
FROM_PREVIOUS, FROM_IMU = "T_cn_cnm1", "T_cam_imu"
_MARKS = ("camera_model", "distortion_model", FROM_PREVIOUS)
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
            where="keys",
        )
    left, right = chain[:2]
    assert right.T_camera_previous is not None
    pose = checked_order(right.T_camera_previous, path=path, where=right.pose_where)
    t_m = in_metres(pose.translation_m, unit, path=path, where=right.pose_where)
    rig = StereoRig(
        left.camera,
        right.camera,
        Pose.from_rotation(RIGHT, LEFT, pose.matrix[:3, :3], t_m),
        origin=path.name,
    )
    more = ", ".join(each.name for each in chain[2:])
    notes = [f"{path.name}: {left.name} is the left camera, {right.name} the right one"]
    notes += [f"{path.name}: {more} left aside"] if more else []
    if FROM_IMU in fields_of_mapping(left.node):
        notes.append(f"{path.name}: {FROM_IMU} left aside")
    rectified = None if why_unrectified(rig) else rig
    return RigReading(path, FORM, rectified, rig, tuple(notes))


def read_chain(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[ChainedCamera, ...]:
    """All cameras of a camchain, in the order of their numbers. Raises as `read_camchain`."""
    documents = read_storage(path, limits=limits)
    fields = fields_of_mapping(documents[0])
    numbers = sorted(int(m[1]) for name in fields if (m := _CAMERA.fullmatch(name)))
    if len(documents) > 1 or not numbers or numbers != list(range(len(numbers))):
        found = ", ".join(list(fields)[:20]) or "nothing"
        raise CalibrationField(
            f"found {found}", want="cam0, cam1, ... in one document", path=path, where="keys"
        )
    frames = [LEFT, RIGHT, *(f"cam{number}" for number in numbers[2:])]
    nodes = [fields[f"cam{number}"] for number in numbers]
    return tuple(_chained(nodes, frames, number) for number in numbers)


def _chained(nodes: list[Node], frames: list[str], number: int) -> ChainedCamera:
    node, name = nodes[number], f"cam{number}"
    camera = camera_of(node, name, frames[number])
    if number == 0:
        return ChainedCamera(name, camera, None, node)
    previous = (f"cam{number - 1}", nodes[number - 1])
    pose, held = _pose(node, name, previous, frames[number], frames[number - 1])
    return ChainedCamera(name, camera, pose, node, held.where)


def _pose(
    node: Node, name: str, previous: tuple[str, Node], dst: str, src: str
) -> tuple[Pose, Node]:
    """`T_cn_cnm1`, or what it is by both cameras' `T_cam_imu`."""
    by_imu = all(FROM_IMU in fields_of_mapping(each) for each in (node, previous[1]))
    if FROM_PREVIOUS in fields_of_mapping(node) or not by_imu:
        return pose_of(node, name, FROM_PREVIOUS, dst, src)
    T_camera_imu, held = pose_of(node, name, FROM_IMU, dst, IMU)
    T_previous_imu, _ = pose_of(previous[1], previous[0], FROM_IMU, src, IMU)
    return T_camera_imu @ T_previous_imu.inverse(), held


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
