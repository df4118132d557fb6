"""Calibration of a single camera in the forms that depth data sets have it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationValue,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.opencv_rig import SUFFIXES
from pseudolidar.formats.rigs.placed import Node, at_place
from pseudolidar.formats.rigs.storage import is_matrix, matrix_of, read_storage
from pseudolidar.formats.text import read_lines
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera

_PUNCTUATION = re.compile(r"[^0-9a-z]+")
_MATRICES = ("cameramatrix", "k", "intrinsic", "intrinsics", "colorintrinsics")
_COLUMN_MAJOR = "intrinsicmatrix"  # Open3D
_DISTORTIONS = ("distortioncoefficients", "distcoeffs", "distortion", "d", "dist")
_SCALES = ("scale", "depthscale", "pngdepthscale", "depthfactor")
# K, K and a baseline, a homogeneous 4x4 (ScanNet).
_COUNTS = (9, 10, 16)


@dataclass(frozen=True, eq=False)
class CameraReading:
    """A camera as a file describes it.

    Args:
        camera: without distortion.
        steps_per_m: depth steps a metre, where the file says it.
        notes: what was assumed.
    """

    camera: Camera
    steps_per_m: float | None = None
    notes: tuple[str, ...] = ()


def read_camera(
    path: Path, *, size_px: tuple[int, int], limits: Limits = DEFAULT_LIMITS
) -> CameraReading:
    """Read a camera: K.txt (9 numbers, 10, or 4x4), JSON with fx fy cx cy or a matrix, YAML, XML.

    Args:
        path: the file.
        size_px: (width, height) of the pictures, for files that do not say it.
        limits: cap on its size.

    Raises:
        CalibrationMissing: no such file.
        CalibrationField: neither a matrix nor focal lengths.
        CalibrationSyntax: no number, another count; by line.
        CalibrationValue: an impossible camera, or one with distortion.
    """
    if path.suffix.lower() in SUFFIXES:
        return _of_fields(path, size_px, limits)
    lines = read_lines(path, error=CalibrationSyntax, missing=CalibrationMissing, limits=limits)
    numbers = [number for line in lines for number in line.numbers(line.words())]
    if len(numbers) not in _COUNTS:
        raise CalibrationSyntax(
            f"{len(numbers)} numbers", want="9 of K, row by row, or 16 of a 4x4", path=path
        )
    side = 4 if len(numbers) == 16 else 3
    matrix = np.array(numbers[: side * side]).reshape(side, side)
    return CameraReading(_camera(matrix[:3, :3].copy(), size_px, path, "K"))


def _of_fields(path: Path, size_px: tuple[int, int], limits: Limits) -> CameraReading:
    fields: dict[str, Node] = {}
    _flatten(read_storage(path, limits=limits)[0], fields)
    K, where = _intrinsics(fields, path)
    distortion = next((fields[name] for name in _DISTORTIONS if name in fields), None)
    if distortion is not None and _bends(distortion):
        raise CalibrationValue(
            "a camera with lens distortion",
            want="undistorted pictures and their camera, distortion 0",
            fix="Undistort picture and depth, or give the camera of the undistorted ones.",
            path=path,
            where=distortion.where,
        )
    sides = [_number(fields, names) for names in (("width", "w", "imagewidth"),
                                                  ("height", "h", "imageheight"))]  # fmt: skip
    size = (int(sides[0]), int(sides[1])) if sides[0] and sides[1] else size_px
    return CameraReading(_camera(K, size, path, where), _number(fields, _SCALES))


def _bends(distortion: Node) -> bool:
    """Whether distortion numbers are there and not all 0."""
    listed = is_matrix(distortion) and distortion.value != ()
    return listed and bool(matrix_of(distortion).any())


def _flatten(node: Node, into: dict[str, Node]) -> None:
    """Values by their own name, whatever they are nested in; the first of each counts."""
    if not isinstance(node.value, dict) or is_matrix(node):
        return
    for key, inner in node.value.items():
        into.setdefault(_PUNCTUATION.sub("", key.lower()), inner)
        _flatten(inner, into)


def _intrinsics(fields: dict[str, Node], path: Path) -> tuple[Float64, str]:
    for name in (_COLUMN_MAJOR, *_MATRICES):
        node = fields.get(name)
        if node is None or not is_matrix(node):
            continue
        found = matrix_of(node)
        if found.size != 9:
            raise CalibrationSyntax(
                f"{found.size} numbers", want="9", path=node.path, where=node.where
            )
        flat_open3d = name == _COLUMN_MAJOR and found.shape[0] == 1
        return found.reshape(3, 3).T.copy() if flat_open3d else found.reshape(3, 3), node.where
    numbers = [_number(fields, (name,)) for name in ("fx", "fy", "cx", "cy")]
    fx, fy, cx, cy = numbers
    if fx is None or fy is None or cx is None or cy is None:
        raise CalibrationField(
            f"no camera matrix; found {', '.join(list(fields)[:20]) or 'nothing'}",
            want="fx, fy, cx and cy, or camera_matrix",
            path=path,
        )
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), fields["fx"].where


def _number(fields: dict[str, Node], names: tuple[str, ...]) -> float | None:
    node = next((fields[name] for name in names if name in fields), None)
    if node is None or isinstance(node.value, bool) or not isinstance(node.value, int | float):
        return None
    if not node.value > 0:
        raise CalibrationValue(
            f"{node.value:g}", want="a number above 0", path=node.path, where=node.where
        )
    return float(node.value)


def _camera(K: Float64, size_px: tuple[int, int], path: Path, where: str) -> Camera:
    if not np.array_equal(K[2], (0.0, 0.0, 1.0)) or K[1, 0] != 0:
        raise CalibrationValue(
            f"a K with rows {K[1].tolist()} and {K[2].tolist()}",
            want="[0, fy, cy] and [0, 0, 1]",
            path=path,
            where=where,
        )
    try:
        return Camera(K, *size_px)
    except CalibrationValue as error:
        raise at_place(error, path=path, where=where) from None
