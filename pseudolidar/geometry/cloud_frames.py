"""In which coordinate frame clouds are handed over."""

from __future__ import annotations

from typing import Literal

from pseudolidar.errors import CalibrationField
from pseudolidar.geometry.frames import BASE_LINK, left_in_base_link
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.pose import Pose

CloudFrame = Literal["velodyne", "camera_left", "base_link"]


def default_frame(rig: StereoRig) -> CloudFrame:
    """`velodyne` where that is calibrated, else `camera_left`."""
    return "camera_left" if rig.T_left_velodyne is None else "velodyne"


def forward_frame(rig: StereoRig, frame: CloudFrame) -> CloudFrame:
    """`frame` where its x points forward; else the Velodyne's, or the turned left camera's."""
    if frame != "camera_left":
        return frame
    return "base_link" if rig.T_left_velodyne is None else "velodyne"


def left_in(rig: StereoRig, frame: CloudFrame) -> Pose:
    """`T_frame_left`: maps points of the left camera to `frame`.

    Raises:
        CalibrationField: the rig does not say where `frame` is.
    """
    if frame == "camera_left":
        return Pose.identity(frame, rig.left.frame)
    if frame == "base_link":
        return left_in_base_link(rig)
    if rig.T_left_velodyne is None:
        raise CalibrationField(
            "no calibration of a Velodyne",
            want="Tr_velo_to_cam or calib_velo_to_cam.txt, or T_left_velodyne in rig.json",
            fix=f"Pass --frame camera_left or --frame {BASE_LINK}.",
            where="T_left_velodyne",
        )
    T_velodyne_left = rig.T_left_velodyne.inverse()
    return Pose(frame, rig.left.frame, T_velodyne_left.matrix)
