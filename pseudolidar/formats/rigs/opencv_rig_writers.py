"""Rigs as OpenCV's YAML and as ROS's `camera_info`, which `opencv_rig.py` reads back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.rigs.rig_reading import RigReading
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig


def write_opencv_yaml(path: Path, rig: StereoRig) -> None:
    """Write a rig as OpenCV's YAML with all digits; of a rectified one with P1, P2 and Q.

    Lengths are metres. OpenCV's FileStorage reads it as well.
    """
    fields: dict[str, Float64] = {}
    for eye, camera in (("1", rig.left), ("2", rig.right)):
        fields |= {f"M{eye}": camera.K, f"D{eye}": _row(camera.distortion)}
    T = rig.T_right_left.matrix
    fields |= {"R": T[:3, :3], "T": T[:3, 3:]}
    if rig.is_rectified:
        fields |= {"R1": np.eye(3), "R2": np.eye(3), "P1": rig.P_left, "P2": rig.P_right}
    width, height = rig.left.size_px
    head = f"%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n"
    body = "".join(_opencv_matrix(name, value) for name, value in fields.items())
    write_atomic(path, (head + body).encode())


def _row(distortion: Float64) -> Float64:
    return (distortion if len(distortion) else np.zeros(5)).reshape(1, -1)


def _opencv_matrix(name: str, value: Float64) -> str:
    rows, cols = value.shape
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n"
        f"   data: [ {_listed(value)} ]\n"
    )


def _listed(value: Float64) -> str:
    return ", ".join(repr(float(x)) for x in value.ravel())


def write_camera_info(left: Path, right: Path, rig: StereoRig) -> None:
    """Write a rectified rig as two ROS `camera_info` YAML files with all digits.

    Raises:
        NotRectified: P of an unrectified rig is not known.
    """
    reading = RigReading(left, "rig", rig if rig.is_rectified else None)
    checked = reading.of_rectified
    sides = ((left, "left", checked.left, checked.P_left),
             (right, "right", checked.right, checked.P_right))  # fmt: skip
    for path, eye, camera, P in sides:
        write_atomic(path, _camera_info_text(eye, camera, P).encode())


def _camera_info_text(eye: str, camera: Camera, P: Float64) -> str:
    matrices = {
        "camera_matrix": camera.K,
        "distortion_coefficients": np.zeros((1, 5)),
        "rectification_matrix": np.eye(3),
        "projection_matrix": P,
    }
    lines = [
        f"image_width: {camera.width_px}",
        f"image_height: {camera.height_px}",
        f"camera_name: {eye}",
        "distortion_model: plumb_bob",
    ]
    for name, value in matrices.items():
        rows, cols = value.shape
        lines += [f"{name}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: [{_listed(value)}]"]
    return "\n".join(lines) + "\n"
