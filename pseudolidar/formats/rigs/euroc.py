"""EuRoC's `sensor.yaml`, one file for each camera, each with its place on the body.

Source: Burri et al., The EuRoC micro aerial vehicle datasets, 2016; the ASL data set format.
"""

from __future__ import annotations

from pathlib import Path

from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.named_lens import camera_of, pose_of
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_parts import LEFT, RIGHT
from pseudolidar.formats.rigs.rig_reading import RigReading, RigUnit, checked_order, in_metres
from pseudolidar.formats.rigs.storage import read_storage
from pseudolidar.geometry.unrectified import why_unrectified
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.pose import Pose

FORM = "EuRoC sensor.yaml"
SENSOR_FILE, CAMERA_FOLDERS = "sensor.yaml", ("cam0", "cam1")
_PLACE, _BODY = "T_BS", "body"


def is_sensor(node: Node) -> bool:
    """Whether a tree of values is a camera of this form: four intrinsics and a place."""
    return isinstance(node.value, dict) and _PLACE in node.value and "intrinsics" in node.value


def read_sensors(
    left: Path, right: Path, *, unit: RigUnit | None = None, limits: Limits = DEFAULT_LIMITS
) -> RigReading:
    """Read the files of two cameras as a rig.

    Args:
        left: file of the left camera.
        right: file of the right one.
        unit: of lengths, where metres are not meant.
        limits: cap on the files.

    Raises:
        CalibrationMissing, CalibrationSyntax, LimitError: as `read_storage`.
        CalibrationField: a key is missing.
        CalibrationValue: a lens model that is not known here, a place that is not rigid, exchanged
            eyes, an impossible camera.
        CalibrationUnits: lengths that are no metres, and `unit` is not given.
    """
    nodes = [read_storage(file, limits=limits)[0] for file in (left, right)]
    names = (left.parent.name or left.name, right.parent.name or right.name)
    cameras = [
        camera_of(node, name, frame)
        for node, name, frame in zip(nodes, names, (LEFT, RIGHT), strict=True)
    ]
    T_body_left, _ = pose_of(nodes[0], names[0], _PLACE, _BODY, LEFT)
    T_body_right, held = pose_of(nodes[1], names[1], _PLACE, _BODY, RIGHT)
    pose = T_body_right.inverse() @ T_body_left
    checked_order(pose, path=right, where=held.where)
    t_m = in_metres(pose.translation_m, unit, path=right, where=held.where)
    rig = StereoRig(
        cameras[0],
        cameras[1],
        Pose.from_rotation(RIGHT, LEFT, pose.matrix[:3, :3], t_m),
        origin=f"{names[0]} and {names[1]}",
    )
    note = f"{names[0]} is the left camera, {names[1]} the right one; the body's place left aside"
    rectified = None if why_unrectified(rig) else rig
    return RigReading(left, FORM, rectified, rig, (note,))


def sensor_files(folder: Path) -> tuple[Path, Path] | None:
    """The files of both cameras in a folder as the data set has it (`mav0`)."""
    left, right = (folder / name / SENSOR_FILE for name in CAMERA_FOLDERS)
    return (left, right) if left.is_file() and right.is_file() else None


def has_sensors(left: Path, right: Path, *, limits: Limits = DEFAULT_LIMITS) -> bool:
    """Whether one of two files is of this form, so that the other one should be."""
    return any(is_sensor(read_storage(file, limits=limits)[0]) for file in (left, right))
