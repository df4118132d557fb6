"""KITTI's cameras as they were mounted: K, D, R and T of the calibration of the raw data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import CalibrationField, CalibrationValue
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.key_values import KeyValues, read_key_values
from pseudolidar.formats.rigs.kitti import RAW_COUNTS
from pseudolidar.formats.rigs.kitti_calibration import FRAME_CAM0, WHICH_LAYOUT, CameraPair
from pseudolidar.formats.rigs.kitti_fields import check_rotation, rigid_file, size_px
from pseudolidar.formats.rigs.placed import at_place
from pseudolidar.formats.rigs.rig_reading import checked_order
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import LEFT_FRAME, RIGHT_FRAME, Camera, StereoRig
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class MountedCamera:
    """One of KITTI's cameras as it was mounted.

    Args:
        K: (3, 3) float64 intrinsic matrix, px.
        distortion: (5,) float64 k1 k2 p1 p2 k3.
        size_px: (width, height) of its pictures.
        T_camera_cam0: pose of camera 0, as it was mounted, in this one.
        where: place of K in the file, for errors.
    """

    K: Float64
    distortion: Float64
    size_px: tuple[int, int]
    T_camera_cam0: Pose
    where: str = ""


@dataclass(frozen=True, eq=False)
class KittiUnrectified:
    """What KITTI's calibration says of the pictures before rectification.

    Args:
        path: the file with the cameras.
        cameras: by their number.
        T_cam0_velodyne: pose of the Velodyne in camera 0 as it was mounted; None where not known.
        T_velodyne_imu: where it is known.
        notes: what is odd about it.
        made: when it was computed, as the file says it.
    """

    path: Path
    cameras: Mapping[int, MountedCamera]
    T_cam0_velodyne: Pose | None = None
    T_velodyne_imu: Pose | None = None
    notes: tuple[str, ...] = ()
    made: str = ""

    def rig(self, cameras: CameraPair, *, date: str = "") -> StereoRig:
        """The rig of two of the cameras, with their distortion.

        Args:
            cameras: numbers of the left and the right one.
            date: day that the calibration is for, for people.

        Raises:
            CalibrationField: a camera is not in the file.
            CalibrationValue: focal length, principal point or baseline impossible.
        """
        left, right = (self._camera(number) for number in cameras)
        T_left_cam0, T_right_cam0 = left.T_camera_cam0, right.T_camera_cam0
        velodyne = self.T_cam0_velodyne
        pose = _named(T_right_cam0 @ T_left_cam0.inverse(), RIGHT_FRAME)
        return StereoRig(
            left=self._placed(left, LEFT_FRAME),
            right=self._placed(right, RIGHT_FRAME),
            T_right_left=checked_order(pose, path=self.path, where=f"T_0{cameras[1]}"),
            T_left_velodyne=velodyne and _named(T_left_cam0 @ velodyne, LEFT_FRAME),
            T_velodyne_imu=self.T_velodyne_imu,
            origin=self._origin(cameras, date),
        )

    def _camera(self, number: int) -> MountedCamera:
        if number in self.cameras:
            return self.cameras[number]
        found = ", ".join(f"K_0{n}" for n in sorted(self.cameras))
        raise CalibrationField(
            f"no camera {number} before rectification; found {found or 'none'}",
            want=f"K_0{number}, D_0{number}, R_0{number}, T_0{number} and S_0{number}",
            fix=WHICH_LAYOUT,
            path=self.path,
            where=f"K_0{number}",
        )

    def _placed(self, camera: MountedCamera, frame: str) -> Camera:
        distortion = np.asarray(camera.distortion)
        try:
            return Camera(camera.K, *camera.size_px, distortion, frame=frame)
        except CalibrationValue as error:
            raise at_place(error, path=self.path, where=camera.where) from None

    def _origin(self, cameras: CameraPair, date: str) -> str:
        of_date = f" of {date}" if date else ""
        made = f", made {self.made}" if self.made else ""
        return f"{self.path.name}{of_date}{made}, cameras {cameras[0]} and {cameras[1]} as mounted"


def read_unrectified_calib(
    cam_to_cam: Path,
    velo_to_cam: Path | None = None,
    imu_to_velo: Path | None = None,
    *,
    limits: Limits = DEFAULT_LIMITS,
) -> KittiUnrectified:
    """Read what the calibration of the raw data says of the unrectified pictures.

    Args:
        cam_to_cam: file of the cameras.
        velo_to_cam: file of the Velodyne, None where it is not there.
        imu_to_velo: file of the IMU, None where it is not there.
        limits: cap on the files.

    Raises:
        CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: as they say.
    """
    fields = read_key_values(cam_to_cam, RAW_COUNTS, hint=WHICH_LAYOUT, limits=limits)
    notes: list[str] = []
    numbers = [n for n in range(4) if f"K_0{n}" in fields]
    if not numbers:
        fields.require("K_00")
    cameras = {n: _mounted(fields, n, notes) for n in numbers}
    velodyne = imu = None
    if velo_to_cam is not None:
        velodyne = rigid_file(velo_to_cam, FRAME_CAM0, "velodyne", notes, limits)
    if imu_to_velo is not None:
        imu = rigid_file(imu_to_velo, "velodyne", "imu", notes, limits)
    made = fields.texts.get("calib_time", "")
    return KittiUnrectified(cam_to_cam, cameras, velodyne, imu, tuple(notes), made)


def _mounted(fields: KeyValues, number: int, notes: list[str]) -> MountedCamera:
    K, D, R, T = (fields.require(f"{name}_0{number}") for name in "KDRT")
    check_rotation(fields, f"R_0{number}", R.reshape(3, 3), notes)
    pose = Pose.from_rotation(f"camera_{number}", FRAME_CAM0, R.reshape(3, 3), T)
    size = size_px(fields, f"S_0{number}")
    where = f"K_0{number}, line {fields.lines[f'K_0{number}']}"
    return MountedCamera(K.reshape(3, 3), D, size, pose, where)


def _named(pose: Pose, dst: str) -> Pose:
    """The pose of KITTI's cameras with the names of the rig's."""
    src = LEFT_FRAME if pose.src.startswith("camera_") else pose.src
    return Pose(dst, src, pose.matrix)
