"""KITTI's calibration files: object, tracking, odometry, stereo, raw; read_x beside write_x."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    StructureError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.key_values import KeyValues, key_values_text, read_key_values
from pseudolidar.formats.rigs.kitti_calibration import FRAME_CAM0, WHICH_LAYOUT, KittiCalibration
from pseudolidar.formats.rigs.kitti_fields import rectifying_pose, rigid_file, rigid_row, size_px
from pseudolidar.formats.rigs.rig_reading import unchanged
from pseudolidar.formats.text import TextLine, read_lines
from pseudolidar.geometry.rectification import Rectification
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig

CAM_TO_CAM, VELO_TO_CAM, IMU_TO_VELO = (
    "calib_cam_to_cam.txt",
    "calib_velo_to_cam.txt",
    "calib_imu_to_velo.txt",
)
# The Velodyne and IMU transforms go by other names in the tracking and odometry data.
VELODYNE_KEYS = ("Tr_velo_to_cam", "Tr_velo_cam", "Tr")
IMU_KEYS = ("Tr_imu_to_velo", "Tr_imu_velo")
RECTIFICATION_KEYS = ("R0_rect", "R_rect")
SEQUENCE_COUNTS = {r"P[0-3]": 12, r"R0?_rect": 9, r"Tr\w*": 12}
RAW_COUNTS = {
    "corner_dist": 1,
    r"S_(rect_)?0[0-3]": 2,
    r"K_0[0-3]": 9,
    r"D_0[0-3]": 5,
    r"R_(rect_)?0[0-3]": 9,
    r"T_0[0-3]": 3,
    r"P_rect_0[0-3]": 12,
}
# A row with a key of its own, with a colon or one of those that KITTI has without.
_KEYED = re.compile(r"[ \t]*(?:[A-Za-z_]\w*[ \t]*:|(?:P[0-3]|R0?_rect|Tr\w*)(?:[ \t]|$))")


# --- object, tracking, stereo 2012, odometry: one file, rows P0..P3 and transforms --------------


def read_object_calib(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> KittiCalibration:
    """Read `calib/NNNNNN.txt` of the object data: P0..P3, R0_rect, Tr_velo_to_cam, Tr_imu_to_velo.

    Raises:
        CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: as they say;
            the IMU alone may be missing.
    """
    fields = _sequence_fields(path, limits)
    fields.require(_present(fields, RECTIFICATION_KEYS))
    fields.require(_present(fields, VELODYNE_KEYS))
    return _of_sequence(fields)


def read_odometry_calib(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> KittiCalibration:
    """Read `calib.txt` of the odometry data or `calib/NNNNNN.txt` of stereo 2012: P0..P3, and Tr.

    Tr comes in a separate download and may be missing. Rows without keys are taken in this order.

    Raises:
        CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: as they say.
    """
    unlabelled = _unlabelled(path, limits)
    if unlabelled is not None:
        return unlabelled
    return _of_sequence(_sequence_fields(path, limits))


def _sequence_fields(path: Path, limits: Limits) -> KeyValues:
    return read_key_values(path, SEQUENCE_COUNTS, hint=WHICH_LAYOUT, limits=limits)


def _present(fields: KeyValues, names: tuple[str, ...]) -> str:
    return next((name for name in names if name in fields), names[0])


def _of_sequence(fields: KeyValues) -> KittiCalibration:
    projections = {n: fields.values[f"P{n}"].reshape(3, 4) for n in range(4) if f"P{n}" in fields}
    if not projections:
        fields.require("P0")
    key, notes = _present(fields, VELODYNE_KEYS), list[str]()
    velodyne = imu = None
    if key in fields:
        velodyne = rigid_row(fields, key, FRAME_CAM0, "velodyne", notes)
        rectification = _present(fields, RECTIFICATION_KEYS)
        if rectification in fields:
            velodyne = rectifying_pose(fields, rectification, notes) @ velodyne
    key = _present(fields, IMU_KEYS)
    if key in fields:
        imu = rigid_row(fields, key, "velodyne", "imu", notes)
    lines = {n: fields.lines[f"P{n}"] for n in projections}
    return KittiCalibration(
        fields.path, projections, velodyne, imu, notes=tuple(notes), lines=lines
    )


def _unlabelled(path: Path, limits: Limits) -> KittiCalibration | None:
    every = read_lines(path, error=CalibrationSyntax, missing=CalibrationMissing, limits=limits)
    lines = [line for line in every if line.text]
    if any(_KEYED.match(line.text) for line in lines) or not any(map(_starts_bare, lines)):
        return None
    names = ("P0", "P1", "P2", "P3", "Tr")
    if len(lines) not in (2, 4, 5):
        raise lines[0].refusal(
            f"{len(lines)} rows without keys", want="P0 and P1, P0 to P3, or those and Tr"
        )
    rows = [np.array(line.numbers(line.words(), count=12)) for line in lines]
    fields = KeyValues(
        path,
        dict(zip(names, rows, strict=False)),
        dict(zip(names, (line.number for line in lines), strict=False)),
        WHICH_LAYOUT,
    )
    calibration = _of_sequence(fields)
    note = f"{path.name}: rows without keys taken as {', '.join(names[: len(lines)])}"
    return replace(calibration, notes=(note, *calibration.notes))


def _starts_bare(line: TextLine) -> bool:
    return line.text.lstrip(" \t")[:1] in "+-.0123456789"


def write_object_calib(path: Path, rig: StereoRig) -> None:
    """Write a rig as `calib/NNNNNN.txt` of the object data: `encode_object_calib`.

    Raises:
        CalibrationField: the rig has no Velodyne, which this layout must have.
    """
    try:
        write_atomic(path, encode_object_calib(rig))
    except CalibrationField as error:
        raise error.located(path) from None


def encode_object_calib(rig: StereoRig) -> bytes:
    """The bytes of `calib/NNNNNN.txt` of the object data, with all digits.

    Cameras 0 and 2 are the left one, 1 and 3 the right one, so that reading any pair gives `rig`.
    The order of the rows is KITTI's: other readers count them.

    Raises:
        CalibrationField: the rig has no Velodyne, which this layout must have.
    """
    if rig.T_left_velodyne is None:
        raise CalibrationField("a rig without a Velodyne", want="T_left_velodyne")
    fields = _projection_fields(rig, "P{}") | {
        "R0_rect": np.eye(3),
        "Tr_velo_to_cam": rig.T_left_velodyne.matrix[:3],
    }
    if rig.T_velodyne_imu is not None:
        fields["Tr_imu_to_velo"] = rig.T_velodyne_imu.matrix[:3]
    return key_values_text(fields).encode()


def write_odometry_calib(path: Path, rig: StereoRig) -> None:
    """Write a rig as `calib.txt` of the odometry data, with all digits; Tr where it is known."""
    fields = _projection_fields(rig, "P{}")
    if rig.T_left_velodyne is not None:
        fields["Tr"] = rig.T_left_velodyne.matrix[:3]
    write_atomic(path, key_values_text(fields).encode())


def _projection_fields(rig: StereoRig, name: str) -> dict[str, Float64 | str]:
    return {name.format(n): rig.P_right if n % 2 else rig.P_left for n in range(4)}


# --- raw, stereo 2015: three files ---------------------------------------------------------------


def read_raw_calib(
    cam_to_cam: Path,
    velo_to_cam: Path | None = None,
    imu_to_velo: Path | None = None,
    *,
    limits: Limits = DEFAULT_LIMITS,
) -> KittiCalibration:
    """Read the calibration of the raw data or of stereo 2015.

    R_rect_00 rectifies for all cameras; Velodyne and IMU are left out where their file is None.

    Raises:
        CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: as they say.
    """
    cameras = read_key_values(cam_to_cam, RAW_COUNTS, hint=WHICH_LAYOUT, limits=limits)
    numbers = [n for n in range(4) if f"P_rect_0{n}" in cameras]
    if not numbers:
        cameras.require("P_rect_00")
    notes: list[str] = []
    velodyne = imu = None
    if velo_to_cam is not None:
        raw = rigid_file(velo_to_cam, FRAME_CAM0, "velodyne", notes, limits)
        velodyne = rectifying_pose(cameras, "R_rect_00", notes) @ raw
    if imu_to_velo is not None:
        imu = rigid_file(imu_to_velo, "velodyne", "imu", notes, limits)
    return KittiCalibration(
        cam_to_cam,
        {n: cameras.values[f"P_rect_0{n}"].reshape(3, 4) for n in numbers},
        velodyne,
        imu,
        sizes_px=_sizes_px(cameras, "S_rect_0"),
        raw_sizes_px=_sizes_px(cameras, "S_0"),
        notes=tuple(notes),
        made=cameras.texts.get("calib_time", ""),
        key="P_rect_0",
        lines={n: cameras.lines[f"P_rect_0{n}"] for n in numbers},
    )


def _sizes_px(fields: KeyValues, prefix: str) -> dict[int, tuple[int, int]]:
    return {n: size_px(fields, f"{prefix}{n}") for n in range(4) if f"{prefix}{n}" in fields}


def write_raw_calib(
    folder: Path,
    rig: StereoRig,
    *,
    rectified: Rectification | None = None,
    calib_time: str = "",
) -> None:
    """Write a rig as the calibration files of the raw data into `folder`, with all digits.

    Args:
        folder: where `calib_cam_to_cam.txt` and, where calibrated, the Velodyne's and the IMU's go.
        rig: cameras 0 and 2 become the left one, 1 and 3 the right one.
        rectified: how pictures of unrectified cameras are rectified; not needed of a rectified rig.
        calib_time: date for the files' first line, such as `09-Jan-2012 13:57:47`.

    Raises:
        NotRectified: an unrectified rig, and nobody says how it is rectified.
        StructureError: a lens that KITTI's five numbers cannot say.
        OutputError: a file cannot be written.
    """
    if rectified is None:
        rectified = unchanged(rig)
    pair = rectified.rig
    head: dict[str, Float64 | str] = {"calib_time": calib_time} if calib_time else {}
    fields = dict(head)
    for n in range(4):
        camera, flat = (rig.right, pair.right) if n % 2 else (rig.left, pair.left)
        pose = rig.T_right_left.matrix if n % 2 else np.eye(4)
        fields |= {f"S_0{n}": np.array(camera.size_px, dtype=np.float64)}
        fields |= {f"K_0{n}": camera.K, f"D_0{n}": _five_numbers(camera)}
        fields |= {f"R_0{n}": pose[:3, :3], f"T_0{n}": pose[:3, 3]}
        fields |= {f"S_rect_0{n}": np.array(flat.size_px, dtype=np.float64)}
        fields |= {f"R_rect_0{n}": rectified.R_right if n % 2 else rectified.R_left}
        fields[f"P_rect_0{n}"] = pair.P_right if n % 2 else pair.P_left
    write_atomic(folder / CAM_TO_CAM, key_values_text(fields).encode())
    for name, mounted in ((VELO_TO_CAM, rig.T_left_velodyne), (IMU_TO_VELO, rig.T_velodyne_imu)):
        if mounted is not None:
            rigid = head | {"R": mounted.matrix[:3, :3], "T": mounted.translation_m}
            write_atomic(folder / name, key_values_text(rigid).encode())


def _five_numbers(camera: Camera) -> Float64:
    """(5,) k1 k2 p1 p2 k3, the only lens model that KITTI has."""
    numbers = np.zeros(5)
    numbers[: len(camera.distortion[:5])] = camera.distortion[:5]
    if camera.model != "pinhole" or camera.distortion[5:].any():
        raise StructureError(
            f"a {camera.model} lens with {len(camera.distortion)} distortion numbers",
            want="k1 k2 p1 p2 k3 of a pinhole lens",
            fix="Write rig.json, OpenCV's YAML or ROS's camera_info instead.",
            where=CAM_TO_CAM,
        )
    return numbers
