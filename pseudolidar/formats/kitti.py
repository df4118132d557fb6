"""Calibrations in KITTI's formats: object, odometry, stereo, tracking, raw.

Everything KITTI says about frames is settled here once: its labels, poses and Velodyne extrinsics
are in rectified camera 0, while the left picture is camera 2 or camera 0. Elsewhere there is only
`camera_left`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationValue,
    PseudolidarError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.key_values import KeyValues, key_values_text, read_key_values
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import read_lines
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import ROTATION_TOLERANCE, Pose, rotation_error

CameraPair = tuple[int, int]
GREY: CameraPair = (0, 1)
COLOUR: CameraPair = (2, 3)
CAMERAS: Mapping[Literal["grey", "colour"], CameraPair] = {"grey": GREY, "colour": COLOUR}

# KITTI writes 7 digits, so that a product of two of its rotations is off by some 1e-6.
ROTATION_NOTED = 1e-5
CAM_TO_CAM, VELO_TO_CAM, IMU_TO_VELO = (
    "calib_cam_to_cam.txt",
    "calib_velo_to_cam.txt",
    "calib_imu_to_velo.txt",
)
FRAME_CAM0 = "camera_0"
WHICH_LAYOUT = "Is this file of the raw, the object or the odometry data, as you meant?"
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
RIGID_COUNTS = {"R": 9, "T": 3, r"delta_[fc]": 2}


@dataclass(frozen=True, eq=False)
class KittiCalibration:
    """What KITTI's calibration files say, before a camera pair is chosen.

    Args:
        path: the file (or the one with the cameras).
        projections: (3, 4) float64 by camera number: points of rectified camera 0 to pixels.
        T_cam0_velodyne: where the file has it, R_rect folded in.
        T_velodyne_imu: where the file has it.
        sizes_px: (width, height) by camera number, where the file has them.
        notes: what is odd about it.
    """

    path: Path
    projections: Mapping[int, Float64]
    T_cam0_velodyne: Pose | None = None
    T_velodyne_imu: Pose | None = None
    sizes_px: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def T_left_cam0(self, left: int) -> Pose:
        """Pose of rectified camera 0 in the left camera, number `left`.

        P = K [I | t] exactly, third row and last column included: t = K^-1 p4.
        """
        return Pose.from_rotation("camera_left", FRAME_CAM0, np.eye(3), self._offset_m(left))

    def rig(self, cameras: CameraPair, *, size_px: tuple[int, int] | None = None) -> StereoRig:
        """The rectified rig of two of the cameras.

        Args:
            cameras: numbers of the left and the right one.
            size_px: (width, height) of the images, for files that do not say it.

        Raises:
            CalibrationField: a camera is not in the file, or nobody knows the image size.
            CalibrationValue: focal length, principal point or baseline impossible.
        """
        left, right = cameras
        T_left_cam0 = self.T_left_cam0(left)
        offset_m = self._offset_m(right) - self._offset_m(left)
        velodyne = self.T_cam0_velodyne
        try:
            return StereoRig(
                left=self._camera(left, "camera_left", size_px),
                right=self._camera(right, "camera_right", size_px),
                T_right_left=Pose.from_rotation("camera_right", "camera_left", np.eye(3), offset_m),
                T_left_velodyne=None if velodyne is None else T_left_cam0 @ velodyne,
                T_velodyne_imu=self.T_velodyne_imu,
                origin=f"{self.path.name}, cameras {left} and {right}",
            )
        except PseudolidarError as error:
            error.located(self.path)
            raise

    def has(self, cameras: CameraPair) -> bool:
        """Whether both cameras are calibrated."""
        return all(camera in self.projections for camera in cameras)

    def _projection(self, camera: int) -> Float64:
        if camera not in self.projections:
            found = ", ".join(f"P{number}" for number in sorted(self.projections))
            raise CalibrationField(
                f"no P{camera}; found {found or 'no camera at all'}",
                want=f"P{camera}",
                fix=WHICH_LAYOUT,
                path=self.path,
                where=f"P{camera}",
            )
        return self.projections[camera]

    def _offset_m(self, camera: int) -> Float64:
        P = self._projection(camera)
        try:
            return np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise CalibrationValue(
                "a singular projection matrix",
                want="focal lengths above 0",
                path=self.path,
                where=f"P{camera}",
            ) from None

    def _camera(self, number: int, frame: str, size_px: tuple[int, int] | None) -> Camera:
        size = self.sizes_px.get(number, size_px)
        if size is None:
            raise CalibrationField("no image size", want=f"S_rect_0{number}", path=self.path)
        return Camera(
            K=self._projection(number)[:, :3].copy(),
            width_px=size[0],
            height_px=size[1],
            frame=frame,
        )


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
        velodyne = _rigid(fields, key, FRAME_CAM0, "velodyne", notes)
        rectification = _present(fields, RECTIFICATION_KEYS)
        if rectification in fields:
            velodyne = _rectification(fields, rectification, notes) @ velodyne
    key = _present(fields, IMU_KEYS)
    if key in fields:
        imu = _rigid(fields, key, "velodyne", "imu", notes)
    return KittiCalibration(fields.path, projections, velodyne, imu, notes=tuple(notes))


def _unlabelled(path: Path, limits: Limits) -> KittiCalibration | None:
    lines = [line for line in read_lines(path, error=CalibrationSyntax, limits=limits) if line.text]
    if not lines or lines[0].text.lstrip(" \t")[0] not in "+-.0123456789":
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
    return KittiCalibration(
        path,
        calibration.projections,
        calibration.T_cam0_velodyne,
        notes=(note, *calibration.notes),
    )


def write_object_calib(path: Path, rig: StereoRig) -> None:
    """Write a rig as `calib/NNNNNN.txt` of the object data, with all digits.

    Cameras 0 and 2 are the left one, 1 and 3 the right one, so that reading any pair gives `rig`.

    Raises:
        CalibrationField: the rig has no Velodyne, which this layout must have.
    """
    if rig.T_left_velodyne is None:
        raise CalibrationField("a rig without a Velodyne", want="T_left_velodyne", path=path)
    fields = _projection_fields(rig, "P{}") | {
        "R0_rect": np.eye(3),
        "Tr_velo_to_cam": rig.T_left_velodyne.matrix[:3],
    }
    if rig.T_velodyne_imu is not None:
        fields["Tr_imu_to_velo"] = rig.T_velodyne_imu.matrix[:3]
    write_atomic(path, key_values_text(fields).encode())


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
        raw = _rigid_file(velo_to_cam, FRAME_CAM0, "velodyne", notes, limits)
        velodyne = _rectification(cameras, "R_rect_00", notes) @ raw
    if imu_to_velo is not None:
        imu = _rigid_file(imu_to_velo, "velodyne", "imu", notes, limits)
    return KittiCalibration(
        cam_to_cam,
        {n: cameras.values[f"P_rect_0{n}"].reshape(3, 4) for n in numbers},
        velodyne,
        imu,
        {n: _size_px(cameras, f"S_rect_0{n}") for n in numbers if f"S_rect_0{n}" in cameras},
        tuple(notes),
    )


def _size_px(fields: KeyValues, key: str) -> tuple[int, int]:
    width, height = fields.require(key)
    return round(float(width)), round(float(height))


def write_raw_calib(folder: Path, rig: StereoRig, *, calib_time: str = "") -> None:
    """Write a rig as the calibration files of the raw data into `folder`, with all digits.

    Args:
        folder: where `calib_cam_to_cam.txt` and, where calibrated, the Velodyne's and the IMU's go.
        rig: cameras 0 and 2 become the left one, 1 and 3 the right one.
        calib_time: date for the files' first line, such as `09-Jan-2012 13:57:47`.
    """
    head: dict[str, Float64 | str] = {"calib_time": calib_time} if calib_time else {}
    fields = dict(head)
    for n in range(4):
        camera = rig.right if n % 2 else rig.left
        t_m = rig.T_right_left.translation_m if n % 2 else np.zeros(3)
        size = np.array(camera.size_px, dtype=np.float64)
        fields |= {f"S_0{n}": size, f"K_0{n}": camera.K, f"D_0{n}": np.zeros(5)}
        fields |= {f"R_0{n}": np.eye(3), f"T_0{n}": t_m}
        fields |= {f"S_rect_0{n}": size, f"R_rect_0{n}": np.eye(3)}
        fields[f"P_rect_0{n}"] = rig.P_right if n % 2 else rig.P_left
    write_atomic(folder / CAM_TO_CAM, key_values_text(fields).encode())
    for name, pose in ((VELO_TO_CAM, rig.T_left_velodyne), (IMU_TO_VELO, rig.T_velodyne_imu)):
        if pose is not None:
            rigid = head | {"R": pose.matrix[:3, :3], "T": pose.translation_m}
            write_atomic(folder / name, key_values_text(rigid).encode())


# --- transforms ----------------------------------------------------------------------------------


def _rigid_file(path: Path, dst: str, src: str, notes: list[str], limits: Limits) -> Pose:
    fields = read_key_values(path, RIGID_COUNTS, hint=WHICH_LAYOUT, limits=limits)
    R, t_m = fields.require("R").reshape(3, 3), fields.require("T")
    _check_rotation(fields, "R", R, notes)
    return Pose.from_rotation(dst, src, R, t_m)


def _rigid(fields: KeyValues, key: str, dst: str, src: str, notes: list[str]) -> Pose:
    matrix = fields.require(key).reshape(3, 4)
    _check_rotation(fields, key, matrix[:, :3], notes)
    return Pose.from_rotation(dst, src, matrix[:, :3], matrix[:, 3])


def _rectification(fields: KeyValues, key: str, notes: list[str]) -> Pose:
    R = fields.require(key).reshape(3, 3)
    _check_rotation(fields, key, R, notes)
    return Pose.from_rotation(FRAME_CAM0, FRAME_CAM0, R, np.zeros(3))


def _check_rotation(fields: KeyValues, key: str, R: Float64, notes: list[str]) -> None:
    error = rotation_error(R)
    if not error <= ROTATION_TOLERANCE:
        raise CalibrationValue(
            f"{key} is no rotation: off by {error:.2g}, determinant {np.linalg.det(R):.4g}",
            want=f"orthonormal to {ROTATION_TOLERANCE:g}, determinant 1",
            path=fields.path,
            where=f"line {fields.lines[key]}",
        )
    if error > ROTATION_NOTED:
        notes.append(f"{fields.path.name}: {key} is a rotation only to {error:.1g}")
