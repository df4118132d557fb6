"""Rigs as OpenCV's YAML, XML and JSON and as ROS's `camera_info`, which `opencv_rig.py` reads."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.rigs.rig_reading import unchanged
from pseudolidar.geometry.rectification import Rectification
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig

Fields = Mapping[str, Float64 | int | str]
# Numbers of ROS's plumb_bob, and of a pinhole lens of which none are known; those of a fisheye.
_PLUMB_BOB, _EQUIDISTANT = 5, 4


# --- OpenCV --------------------------------------------------------------------------------------


def write_opencv(path: Path, rig: StereoRig, rectified: Rectification | None = None) -> None:
    """Write a rig as OpenCV's FileStorage has it, with all digits; lengths are metres.

    M1 D1 M2 D2 R T are of the pictures as they are taken. R1 R2 P1 P2 Q are written where it is
    known how they are rectified: who reads them takes pictures for rectified.

    Args:
        path: YAML, or XML or JSON by its suffix.
        rig: the cameras as they are.
        rectified: how they are rectified; not needed of a rig that is rectified.

    Raises:
        OutputError: the file cannot be written.
    """
    text = _TEXTS.get(path.suffix.lower(), _yaml)
    write_atomic(path, text(_opencv_fields(rig, rectified)).encode())


def _opencv_fields(rig: StereoRig, rectified: Rectification | None) -> Fields:
    T = rig.T_right_left.matrix
    fields: dict[str, Float64 | int | str] = dict(_size_fields(rig))
    models = (rig.left.model, rig.right.model)
    if models[0] != models[1]:
        fields |= {"distortion_model1": models[0], "distortion_model2": models[1]}
    elif models[0] != "pinhole":
        fields["distortion_model"] = models[0]
    for eye, camera in (("1", rig.left), ("2", rig.right)):
        fields |= {f"M{eye}": camera.K, f"D{eye}": _row(camera)}
    fields |= {"R": T[:3, :3], "T": T[:3, 3:]}
    if rectified is None and rig.is_rectified:
        rectified = unchanged(rig)
    if rectified is not None:
        pair = rectified.rig
        fields |= {"R1": rectified.R_left, "R2": rectified.R_right}
        fields |= {"P1": pair.P_left, "P2": pair.P_right}
        if pair.left.K[0, 0] == pair.left.K[1, 1]:  # OpenCV's Q knows square pixels alone
            fields["Q"] = pair.Q
    return fields


def _size_fields(rig: StereoRig) -> dict[str, int]:
    if rig.left.size_px == rig.right.size_px:
        return {"image_width": rig.left.width_px, "image_height": rig.left.height_px}
    fields: dict[str, int] = {}
    for eye, camera in (("1", rig.left), ("2", rig.right)):
        fields |= {f"image_width{eye}": camera.width_px, f"image_height{eye}": camera.height_px}
    return fields


def _row(camera: Camera) -> Float64:
    """(1, n) distortion; OpenCV knows no camera without."""
    count = _EQUIDISTANT if camera.model == "fisheye" else _PLUMB_BOB
    numbers = camera.distortion if len(camera.distortion) else np.zeros(count)
    return numbers.reshape(1, -1)


def _yaml(fields: Fields) -> str:
    lines = ["%YAML:1.0", "---"]
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            rows, cols = value.shape
            lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}"]
            lines += ["   dt: d", f"   data: [ {_listed(value)} ]"]
        else:
            lines.append(f"{name}: {value}")
    return "\n".join(lines) + "\n"


def _xml(fields: Fields) -> str:
    lines = ['<?xml version="1.0"?>', "<opencv_storage>"]
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            rows, cols = value.shape
            numbers = _listed(value).replace(",", "")
            lines += [f'<{name} type_id="opencv-matrix">', f"  <rows>{rows}</rows>"]
            lines += [
                f"  <cols>{cols}</cols>",
                "  <dt>d</dt>",
                f"  <data>{numbers}</data></{name}>",
            ]
        else:
            lines.append(f"<{name}>{value}</{name}>")
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def _json(fields: Fields) -> str:
    parts = []
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            rows, cols = value.shape
            head = f'"type_id": "opencv-matrix", "rows": {rows}, "cols": {cols}, "dt": "d"'
            parts.append(f'  "{name}": {{{head}, "data": [{_listed(value)}]}}')
        else:
            parts.append(f'  "{name}": {json.dumps(value)}')
    return "{\n" + ",\n".join(parts) + "\n}\n"


_TEXTS: Mapping[str, Callable[[Fields], str]] = {".xml": _xml, ".json": _json}


def _listed(value: Float64) -> str:
    return ", ".join(repr(float(x)) for x in value.ravel())


# --- ROS -----------------------------------------------------------------------------------------


def write_camera_info(left: Path, right: Path, rectified: Rectification) -> None:
    """Write the cameras as they are, and how they are rectified, as two `camera_info` YAML files.

    K and D are of the pictures as they are taken, R and P of the rectified ones.

    Args:
        left: file of the left camera.
        right: file of the right one.
        rectified: how the pictures are rectified; `unchanged` of a rig that is.

    Raises:
        OutputError: a file cannot be written.
    """
    raw, pair = rectified.raw, rectified.rig
    for path, eye, camera, R, P in (
        (left, "left", raw.left, rectified.R_left, pair.P_left),
        (right, "right", raw.right, rectified.R_right, pair.P_right),
    ):
        write_atomic(path, _camera_info_text(eye, camera, R, P).encode())


def _camera_info_text(eye: str, camera: Camera, R: Float64, P: Float64) -> str:
    matrices = {
        "camera_matrix": camera.K,
        "distortion_coefficients": _row(camera),
        "rectification_matrix": R,
        "projection_matrix": P,
    }
    lines = [
        f"image_width: {camera.width_px}",
        f"image_height: {camera.height_px}",
        f"camera_name: {eye}",
        f"distortion_model: {_ros_model(camera)}",
    ]
    for name, value in matrices.items():
        rows, cols = value.shape
        lines += [f"{name}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: [{_listed(value)}]"]
    return "\n".join(lines) + "\n"


def _ros_model(camera: Camera) -> str:
    """ROS's name of the lens model; 8 and more numbers go to OpenCV as they are."""
    if camera.model == "fisheye":
        return "equidistant"
    return "plumb_bob" if len(camera.distortion) <= _PLUMB_BOB else "rational_polynomial"
