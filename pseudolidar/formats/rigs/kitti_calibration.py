"""What a KITTI calibration says, whatever file it came from, and the rig it makes.

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

from pseudolidar.errors import CalibrationField, CalibrationValue, PseudolidarError
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

CameraPair = tuple[int, int]
GREY: CameraPair = (0, 1)
COLOUR: CameraPair = (2, 3)
CAMERAS: Mapping[Literal["grey", "colour"], CameraPair] = {"grey": GREY, "colour": COLOUR}

FRAME_CAM0 = "camera_0"
WHICH_LAYOUT = "Is this file of the raw, the object or the odometry data, as you meant?"


@dataclass(frozen=True, eq=False)
class KittiCalibration:
    """What KITTI's calibration files say, before a camera pair is chosen.

    Args:
        path: the file (or the one with the cameras).
        projections: (3, 4) float64 by camera number: points of rectified camera 0 to pixels.
        T_cam0_velodyne: where the file has it, R_rect folded in.
        T_velodyne_imu: where the file has it.
        sizes_px: (width, height) by camera number, where the file has them.
        raw_sizes_px: those before rectification.
        notes: what is odd about it.
        date: day of the drives that it is for, such as `2011_09_26`, where it is known.
        made: when it was computed, as the file says it.
        key: what precedes the camera's number in the file's names of projections.
    """

    path: Path
    projections: Mapping[int, Float64]
    T_cam0_velodyne: Pose | None = None
    T_velodyne_imu: Pose | None = None
    sizes_px: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    raw_sizes_px: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    date: str = ""
    made: str = ""
    key: str = "P"

    @property
    def described(self) -> str:
        """Which calibration it is, in words: file, date, time of making."""
        of_date = f" of {self.date}" if self.date else ""
        return f"{self.path.name}{of_date}" + (f", made {self.made}" if self.made else "")

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
                origin=f"{self.described}, cameras {left} and {right}",
            )
        except PseudolidarError as error:
            error.located(self.path)
            raise

    def has(self, cameras: CameraPair) -> bool:
        """Whether both cameras are calibrated."""
        return all(camera in self.projections for camera in cameras)

    def _projection(self, camera: int) -> Float64:
        if camera not in self.projections:
            name = f"{self.key}{camera}"
            found = ", ".join(f"{self.key}{number}" for number in sorted(self.projections))
            raise CalibrationField(
                f"no {name}; found {found or 'no camera at all'}",
                want=name,
                fix=WHICH_LAYOUT,
                path=self.path,
                where=name,
            )
        return self.projections[camera]

    def _offset_m(self, camera: int) -> Float64:
        P = self._projection(camera)
        try:
            if not np.array_equal(P[2, :3], (0.0, 0.0, 1.0)):
                raise np.linalg.LinAlgError
            return np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise CalibrationValue(
                f"{self.key}{camera} is no projection of a rectified camera",
                want="K [I | t] with focal lengths above 0 and third row 0 0 1",
                path=self.path,
                where=f"{self.key}{camera}",
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
