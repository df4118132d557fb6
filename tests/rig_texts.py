"""Calibrations of one pair as each program writes them, to be spoilt one place at a time.

All lengths are metres and all numbers are made up. `FORMS` has the files of each form, and what a
user passes for it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

SIZE_PX = (640, 480)
_EYE = [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]
_LENS = [-0.1, 0.05, 0.001, -0.002, 0.01]
_MATRICES: dict[str, tuple[int, int, list[float]]] = {
    "M1": (3, 3, [500.5, 0, 320.0, 0, 501.5, 240.0, 0, 0, 1.0]),
    "D1": (1, 5, _LENS),
    "M2": (3, 3, [502.5, 0, 321.0, 0, 503.5, 241.0, 0, 0, 1.0]),
    "D2": (1, 5, _LENS),
    "R": (3, 3, _EYE),
    "T": (3, 1, [-0.125, 0.001, 0.002]),
}


@dataclass(frozen=True)
class Form:
    """Whole files of a calibration.

    Args:
        files: texts by name; the last one is the one to spoil.
        given: what a user passes.
    """

    files: Mapping[str, str]
    given: str

    def written(self, folder: Path, *changes: tuple[str, str]) -> str:
        """Write it, with each text of `changes` replaced once in the last file."""
        name = list(self.files)[-1]
        text = self.files[name]
        for old, new in changes:
            assert text.count(old) > 0, f"{old!r} is not in {name}"
            text = text.replace(old, new, 1)
        for file, whole in {**self.files, name: text}.items():
            (folder / file).write_text(whole)
        return ",".join(str(folder / part) for part in self.given.split(","))


def _yaml() -> str:
    lines = ["%YAML:1.0", "---", "image_width: 640", "image_height: 480"]
    for name, (rows, cols, data) in _MATRICES.items():
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}", "   dt: d"]
        lines.append(f"   data: {data}")
    return "\n".join(lines) + "\n"


def _xml() -> str:
    lines = ['<?xml version="1.0"?>', "<opencv_storage>", "<image_width>640</image_width>"]
    lines.append("<image_height>480</image_height>")
    for name, (rows, cols, data) in _MATRICES.items():
        lines += [f'<{name} type_id="opencv-matrix">', f"  <rows>{rows}</rows>"]
        lines += [f"  <cols>{cols}</cols>", "  <dt>d</dt>"]
        lines.append(f"  <data>{' '.join(map(str, data))}</data></{name}>")
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def _json() -> str:
    fields: dict[str, object] = {"image_width": 640, "image_height": 480}
    for name, (rows, cols, data) in _MATRICES.items():
        head = {"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d"}
        fields[name] = head | {"data": data}
    lines = (f'"{key}": {json.dumps(value)}' for key, value in fields.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _camera_info(eye: str, offset: float) -> str:
    matrices = {
        "camera_matrix": (3, 3, [500.5, 0.0, 320.0, 0.0, 501.5, 240.0, 0.0, 0.0, 1.0]),
        "distortion_coefficients": (1, 5, _LENS),
        "rectification_matrix": (3, 3, _EYE),
        "projection_matrix": (
            3,
            4,
            [480.0, 0.0, 322.0, offset, 0.0, 480.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        ),
    }
    lines = ["image_width: 640", "image_height: 480", f"camera_name: narrow_stereo/{eye}"]
    lines.append("distortion_model: plumb_bob")
    for name, (rows, cols, data) in matrices.items():
        lines += [f"{name}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: {data}"]
    return "\n".join(lines) + "\n"


KALIBR = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.281, 0.071, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.5, 457.5, 367.25, 248.5]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 0.9999500004166653, 0.009999833334166664, 0.0004]
  - [0.0, -0.009999833334166664, 0.9999500004166653, -0.0009]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.282, 0.072, -0.0001, -3.5e-05]
  distortion_model: radtan
  intrinsics: [457.5, 456.5, 379.75, 255.25]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""
_EYE_ROW = "1 0 0 0 1 0 0 0 1"


def _P(offset: float) -> str:
    return f"7.0e+02 0 3.2e+02 {offset:.2f} 0 7.0e+02 2.4e+02 0 0 0 1 0"


_PROJECTIONS = [_P(0), _P(-380), _P(45), _P(-330)]
_TR = "0 -1 0 0.01 0 0 -1 -0.08 1 0 0 -0.27"
KITTI_OBJECT = (
    "".join(f"P{n}: {P}\n" for n, P in enumerate(_PROJECTIONS))
    + f"R0_rect: {_EYE_ROW}\nTr_velo_to_cam: {_TR}\nTr_imu_to_velo: 1 0 0 -.8 0 1 0 .3 0 0 1 -.8\n"
)


def _kitti_raw() -> str:
    text = "calib_time: 09-Jan-2026 13:57:47\ncorner_dist: 9.95e-02\n"
    for n, (P, x_m) in enumerate(zip(_PROJECTIONS, (0, -0.54, 0.06, -0.47), strict=True)):
        text += f"S_0{n}: 6.4e+02 4.8e+02\nK_0{n}: 7.0e+02 0 3.2e+02 0 7.0e+02 2.4e+02 0 0 1\n"
        text += f"D_0{n}: -0.3 0.1 0 0 0\nR_0{n}: {_EYE_ROW}\nT_0{n}: {x_m} 0 0\n"
        text += f"S_rect_0{n}: 6.4e+02 4.8e+02\nR_rect_0{n}: {_EYE_ROW}\nP_rect_0{n}: {P}\n"
    return text


RIG = {
    "schema": 1,
    "width_px": 640,
    "height_px": 480,
    "left": {"K": [[500.5, 0, 320], [0, 501.5, 240], [0, 0, 1]], "distortion": _LENS},
    "right": {"fx": 502.5, "fy": 503.5, "cx": 321.0, "cy": 241.0, "distortion": _LENS},
    "T_right_left": {"R": [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]], "t_m": [-0.125, 0.001, 0.002]},
}
MIDDLEBURY = """\
cam0=[994.5 0 311.25; 0 994.5 254.75; 0 0 1]
cam1=[994.5 0 342.25; 0 994.5 254.75; 0 0 1]
doffs=31
baseline=193.25
width=640
height=480
ndisp=70
"""
MATRICES = """\
p_left = [[500.5, 0.0, 320.0, 0.0],
          [0.0, 500.5, 240.0, 0.0],
          [0.0, 0.0, 1.0, 0.0]]
p_right = [[500.5, 0.0, 320.0, -60.25],
           [0.0, 500.5, 240.0, 0.0],
           [0.0, 0.0, 1.0, 0.0]]
"""
_RIG_LINES = ",\n".join(f'"{key}": {json.dumps(value)}' for key, value in RIG.items())
FORMS = {
    "yaml": Form({"stereo.yml": _yaml()}, "stereo.yml"),
    "xml": Form({"stereo.xml": _xml()}, "stereo.xml"),
    "json": Form({"stereo.json": _json()}, "stereo.json"),
    "ros": Form(
        {"left.yaml": _camera_info("left", 0.0), "right.yaml": _camera_info("right", -57.6)},
        "left.yaml,right.yaml",
    ),
    "kalibr": Form({"camchain.yaml": KALIBR}, "camchain.yaml"),
    "object": Form({"000000.txt": KITTI_OBJECT}, "000000.txt"),
    "bare": Form({"calib.txt": f"{_PROJECTIONS[0]}\n{_PROJECTIONS[1]}\n"}, "calib.txt"),
    "raw": Form({"calib_cam_to_cam.txt": _kitti_raw()}, "calib_cam_to_cam.txt"),
    "rig": Form({"rig.json": "{" + _RIG_LINES + "}\n"}, "rig.json"),
    "middlebury": Form({"calib.txt": MIDDLEBURY}, "calib.txt"),
    "k": Form({"K.txt": "500.5 0 320 0 500.5 240 0 0 1\n0.125\n"}, "K.txt"),
    "matrices": Form({"camera_data.txt": MATRICES}, "camera_data.txt"),
}
