"""What a KITTI calibration says, whatever file it came from, and the rig it makes.

Everything KITTI says about frames is settled here once: its labels, poses and Velodyne extrinsics
are in rectified camera 0, while the left picture is camera 2 or camera 0. Elsewhere there is only
`camera_left`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import CalibrationField, CalibrationUnits, CalibrationValue
from pseudolidar.formats.rigs.placed import at_place
from pseudolidar.formats.rigs.rig_parts import LARGEST_BASELINE_M
from pseudolidar.formats.rigs.rig_reading import checked_order, of_one_rectification
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import LEFT_FRAME, RIGHT_FRAME, Camera, StereoRig
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
        lines: where the projections stand, by camera number, where it is known.
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
    lines: Mapping[int, int] = field(default_factory=dict)

    @property
    def described(self) -> str:
        """Which calibration it is, in words: file, date, time of making."""
        of_date = f" of {self.date}" if self.date else ""
        return f"{self.path.name}{of_date}" + (f", made {self.made}" if self.made else "")

    def T_left_cam0(self, left: int) -> Pose:
        """Pose of rectified camera 0 in the left camera, number `left`.

        P = K [I | t] exactly, third row and last column included: t = K^-1 p4.
        """
        return Pose.from_rotation(LEFT_FRAME, FRAME_CAM0, np.eye(3), self._offset_m(left))

    def rig(self, cameras: CameraPair, *, size_px: tuple[int, int] | None = None) -> StereoRig:
        """The rectified rig of two of the cameras.

        Args:
            cameras: numbers of the left and the right one.
            size_px: (width, height) of the images, for files that do not say it.

        Raises:
            CalibrationField: a camera is not in the file, or nobody knows the image size.
            CalibrationValue: focal length, principal point or baseline impossible; cameras that
                contradict each other.
            CalibrationUnits: a baseline that is not in metres.
        """
        left, right = cameras
        T_left_cam0 = self.T_left_cam0(left)
        velodyne = self.T_cam0_velodyne
        rig = StereoRig(
            left=self._camera(left, LEFT_FRAME, size_px),
            right=self._camera(right, RIGHT_FRAME, size_px),
            T_right_left=self._T_right_left(left, right),
            T_left_velodyne=None if velodyne is None else T_left_cam0 @ velodyne,
            T_velodyne_imu=self.T_velodyne_imu,
            origin=f"{self.described}, cameras {left} and {right}",
        )
        names = f"{self.key}{left} and {self.key}{right}"
        return of_one_rectification(rig, names, path=self.path, where=self._place(right))

    def _T_right_left(self, left: int, right: int) -> Pose:
        offset_m = self._offset_m(right) - self._offset_m(left)
        pose = Pose.from_rotation(RIGHT_FRAME, LEFT_FRAME, np.eye(3), offset_m)
        distance_m = math.hypot(*offset_m)
        if distance_m > LARGEST_BASELINE_M:
            raise CalibrationUnits(
                f"cameras {distance_m:g} m apart",
                want=f"at most {LARGEST_BASELINE_M:g} m: KITTI's lengths are metres",
                fix="Is it in millimetres? Divide column 4 of all P by 1000.",
                path=self.path,
                where=self._place(right),
            )
        return checked_order(pose, path=self.path, where=self._place(right))

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
                where=self._place(camera),
            ) from None

    def _place(self, camera: int) -> str:
        line = f", line {self.lines[camera]}" if camera in self.lines else ""
        return f"{self.key}{camera}{line}"

    def _camera(self, number: int, frame: str, size_px: tuple[int, int] | None) -> Camera:
        size = self.sizes_px.get(number, size_px)
        if size is None:
            raise CalibrationField("no image size", want=f"S_rect_0{number}", path=self.path)
        try:
            return Camera(self._projection(number)[:, :3].copy(), *size, frame=frame)
        except CalibrationValue as error:
            raise at_place(error, path=self.path, where=self._place(number)) from None
