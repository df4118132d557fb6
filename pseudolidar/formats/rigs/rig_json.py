"""The stereo rig as a JSON file that people can read and write by hand.

The form is described by `rig.schema.json` beside this file. The least that a rectified pair needs
is `MINIMAL_RIG`.
"""

from __future__ import annotations

import importlib.resources
import json
from pathlib import Path
from typing import Any, cast

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationValue,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_fields import MINIMAL_RIG, count, fields_of, text, truth
from pseudolidar.formats.rigs.rig_parts import (
    IMU,
    LARGEST_BASELINE_M,
    LEFT,
    RIGHT,
    VELODYNE,
    T_right_left,
    camera,
    correction,
    lidar_pitch,
    optional_pose,
    rows,
)
from pseudolidar.formats.rigs.rig_quality import quality, quality_fields
from pseudolidar.formats.rigs.strict_json import parse_json
from pseudolidar.formats.text import read_lines
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.pose import Pose, rotation_error

SCHEMA = 1
OPTIONAL = (
    "origin",
    "right",
    "baseline_m",
    "T_right_left",
    "T_left_velodyne",
    "T_velodyne_imu",
    "correction",
    "rows",
    "quality",
    "metric",
    "lidar_pitch_rad",
)
# Seven digits of a rotation are enough for this; beyond it the numbers were rounded.
ROUNDED_ROTATION = 1e-6


def rig_schema() -> dict[str, Any]:
    """The JSON Schema of a rig file."""
    file = importlib.resources.files(__package__) / "rig.schema.json"
    return cast("dict[str, Any]", json.loads(file.read_text("utf-8")))


def read_rig(path: str | Path, *, limits: Limits = DEFAULT_LIMITS) -> StereoRig:
    """Read a rig file.

    Raises:
        CalibrationMissing: no such file.
        CalibrationSyntax: not JSON, a value of the wrong form or number; with place and line.
        CalibrationField: a key missing, unknown or twice.
        CalibrationValue: an impossible value.
    """
    path = Path(path)
    if not path.exists():
        raise missing_rig(path)
    lines = read_lines(path, error=CalibrationSyntax, limits=limits)
    return parse_rig("\n".join(line.text for line in lines), path)


def missing_rig(path: str | Path) -> CalibrationMissing:
    """The error of a source without a rig file; shows the least that one needs."""
    fix = f"Write the rig of a rectified pair into it, such as: {MINIMAL_RIG}"
    return CalibrationMissing("no such file", want="a rig", fix=fix, path=path)


def parse_rig(document: str, path: str | Path) -> StereoRig:
    """The rig in `document`; `path` names it in errors. Raises as `read_rig`."""
    root = parse_json(document, path)
    if isinstance(root.value, dict) and "pairs" in root.value:
        raise _several(root.value["pairs"], path)
    try:
        rig, fields = rig_of_fields(root, ("schema",), ("$schema",))
    except PseudolidarError as error:
        raise error.located(path) from None
    checked_schema(fields["schema"])
    return rig


def _several(pairs: Node, path: str | Path) -> CalibrationField:
    names = list(pairs.value) if isinstance(pairs.value, dict) else []
    return CalibrationField(
        f"{len(names)} pairs: {', '.join(names)}",
        want="one of them",
        fix=f"Name it: {path}#{names[0] if names else 'NAME'}.",
        path=path,
        where=pairs.where,
    )


def checked_schema(node: Node) -> None:
    """Raise `CalibrationValue` unless a file is of the version that is read here."""
    if count(node) != SCHEMA:
        raise CalibrationValue(
            f"schema {node.value!r}",
            want=str(SCHEMA),
            fix="A newer version of the program may have written it.",
            path=node.path,
            where=node.where,
        )


def rig_of_fields(
    node: Node, required: tuple[str, ...] = (), optional: tuple[str, ...] = ()
) -> tuple[StereoRig, dict[str, Node]]:
    """The rig of an object, and its fields; those of a rig file, and others beside them.

    Raises:
        CalibrationSyntax, CalibrationField, CalibrationValue: as `read_rig`.
    """
    fields = fields_of(node, (*required, "width_px", "height_px", "left"), (*OPTIONAL, *optional))
    size = count(fields["width_px"]), count(fields["height_px"])
    left = camera(fields["left"], size, LEFT)
    right = camera(fields.get("right", fields["left"]), size, RIGHT)
    rig = StereoRig(
        left,
        right,
        T_right_left(node, fields),
        T_left_velodyne=optional_pose(fields, "T_left_velodyne", LEFT, VELODYNE),
        T_velodyne_imu=optional_pose(fields, "T_velodyne_imu", VELODYNE, IMU),
        correction=correction(fields["correction"]) if "correction" in fields else None,
        rows=rows(fields["rows"]) if "rows" in fields else None,
        quality=quality(fields["quality"]) if "quality" in fields else None,
        origin=text(fields["origin"]) if "origin" in fields else "",
        metric=truth(fields["metric"]) if "metric" in fields else True,
        lidar_pitch_rad=lidar_pitch(fields["lidar_pitch_rad"])
        if "lidar_pitch_rad" in fields
        else 0.0,
    )
    return rig, fields


def write_rig(path: str | Path, rig: StereoRig) -> None:
    """Write a rig file; reading it gives the same rig, bit for bit.

    Raises:
        StructureError: frames of the rig have other names than the file's.
        OutputError: the disk is full or not writable.
    """
    write_atomic(Path(path), rig_text(rig).encode())


def rig_text(rig: StereoRig) -> str:
    """The rig as text of a rig file."""
    return pretty({"schema": SCHEMA} | rig_fields_of(rig)) + "\n"


def rig_fields_of(rig: StereoRig) -> dict[str, Any]:
    """The fields of a rig file without its version."""
    _check_frames(rig)
    fields: dict[str, Any] = {}
    if rig.origin:
        fields["origin"] = rig.origin
    fields |= {"width_px": rig.left.width_px, "height_px": rig.left.height_px}
    fields |= {"left": _camera_fields(rig.left, rig.left.size_px)}
    fields |= {"right": _camera_fields(rig.right, rig.left.size_px)}
    if not rig.metric:
        fields["metric"] = False
    t_m = rig.T_right_left.translation_m
    along_row = np.array_equal(t_m[1:], (0, 0)) and 0 < -t_m[0] <= LARGEST_BASELINE_M
    if along_row and np.array_equal(rig.T_right_left.matrix[:3, :3], np.eye(3)):
        fields["baseline_m"] = -float(t_m[0])
    else:
        fields["T_right_left"] = pose_fields(rig.T_right_left)
    for name in ("T_left_velodyne", "T_velodyne_imu"):
        pose = getattr(rig, name)
        if pose is not None:
            fields[name] = pose_fields(pose)
    if rig.lidar_pitch_rad:
        fields["lidar_pitch_rad"] = rig.lidar_pitch_rad
    for name, part in (("correction", rig.correction), ("rows", rig.rows)):
        if part is not None:
            fields[name] = {
                "coefficients": part.coefficients.tolist(),
                "residual_px": part.residual_px,
                "origin": part.origin,
            }
    if rig.correction is not None:
        fields["correction"] |= _uncertainty_fields(rig.correction)
    if rig.quality is not None:
        fields["quality"] = quality_fields(rig.quality)
    return fields


def _uncertainty_fields(correction: DisparityCorrection) -> dict[str, Any]:
    scale = correction.sigma_scale
    fields: dict[str, Any] = {"sigma_scale": float(scale.factors[0])}
    if len(scale.factors) > 1:
        fields["sigma_scale"] = np.stack([scale.disparities_px, scale.factors], axis=1).tolist()
    if correction.fitted_m is not None:
        fields["fitted_m"] = list(correction.fitted_m)
    if correction.covariance is not None:
        fields["covariance"] = correction.covariance.tolist()
    return fields


def rig_notes(rig: StereoRig) -> tuple[str, ...]:
    """What is worth saying about a rig: rotations that were rounded, corrections, quality."""
    poses = (rig.T_right_left, rig.T_left_velodyne, rig.T_velodyne_imu)
    errors = {
        f"T_{pose.dst}_{pose.src}": rotation_error(pose.matrix[:3, :3]) for pose in poses if pose
    }
    notes = [
        f"warning: rotation of {name} is orthonormal to {error:.1e} only"
        for name, error in errors.items()
        if error > ROUNDED_ROTATION
    ]
    if not rig.metric:
        notes.append("scale unknown: lengths are in a unit that nobody knows, not in metres")
    if rig.correction is not None:
        origin = rig.correction.origin or "unknown origin"
        notes.append(f"refined rig: leaves {rig.correction.residual_px:.2f} px ({origin})")
    if rig.lidar_pitch_rad:
        degrees = np.rad2deg(rig.lidar_pitch_rad)
        notes.append(f"scans are raised by {degrees:.3f} degrees: their LiDAR's pitch was off")
    if rig.quality is not None and str(rig.quality):
        notes.append(f"calibration: {rig.quality}")
    if rig.quality is not None and rig.quality.searched_from_m is not None:
        notes.append(
            f"nearest depth: {rig.quality.searched_from_m:g} m, as near as the board was held; "
            "--min-depth takes another"
        )
    return tuple(notes)


def _check_frames(rig: StereoRig) -> None:
    """Names of frames are not in the file: they are always the same."""
    poses = (rig.T_right_left, rig.T_left_velodyne, rig.T_velodyne_imu)
    wanted = ((RIGHT, LEFT), (LEFT, VELODYNE), (VELODYNE, IMU))
    found = [(rig.left.frame, rig.right.frame), *((p.dst, p.src) if p else None for p in poses)]
    for got, want in zip(found, ((LEFT, RIGHT), *wanted), strict=True):
        if got not in (None, want):
            raise StructureError(f"frames {got}", want=f"{want}", where="write_rig")


def _camera_fields(camera: Camera, size_px: tuple[int, int]) -> dict[str, Any]:
    fields: dict[str, Any] = {"K": camera.K.tolist()}
    if len(camera.distortion):
        fields["distortion"] = camera.distortion.tolist()
    if camera.model != "pinhole":
        fields["model"] = camera.model
    if camera.size_px != size_px:
        fields |= {"width_px": camera.width_px, "height_px": camera.height_px}
    return fields


def pose_fields(pose: Pose) -> dict[str, Any]:
    """The fields of a pose."""
    return {"R": pose.matrix[:3, :3].tolist(), "t_m": pose.matrix[:3, 3].tolist()}


def pretty(value: Any, indent: str = "") -> str:
    """JSON with a line for each key and each row of a matrix."""
    inner = indent + "  "
    if isinstance(value, dict):
        rows = [f"{json.dumps(key)}: {pretty(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(inner + row for row in rows) + f"\n{indent}}}"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + ",\n".join(inner + json.dumps(row) for row in value) + f"\n{indent}]"
    # A text that no encoding can hold (a path's undecodable bytes) is written in escapes.
    unprintable = isinstance(value, str) and not value.isprintable()
    return json.dumps(value, ensure_ascii=unprintable)
