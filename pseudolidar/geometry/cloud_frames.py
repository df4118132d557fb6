"""In which coordinate frame clouds are handed over."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from pseudolidar.errors import CalibrationField, UsageError
from pseudolidar.geometry.frame_chain import ancestors, chain
from pseudolidar.geometry.frames import BASE_LINK, MAP, R_BODY_OPTICAL, left_in_base_link
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

# Of pairs one of `PAIR_FRAMES`; of ready-made clouds any that their source knows.
CloudFrame: TypeAlias = str
PAIR_FRAMES = ("velodyne", "camera_left", "base_link")

# Farther from its origin a frame needs float64: steps of float32 are wider than half a millimetre.
FLOAT32_REACH_M = 4096.0

# Names of frames with a camera's axes (x right, y down, z forward), by REP-103 and by habit.
_OPTICAL = re.compile(r"camera_(left|right)|cam[0-9]|.*_optical(_frame)?")


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
        UsageError: no such frame.
        CalibrationField: the rig does not say where `frame` is.
    """
    if frame not in PAIR_FRAMES:
        raise UsageError(f"frame {frame!r}", want=f"one of {', '.join(PAIR_FRAMES)}")
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


def placed(cloud: PointCloud, tree: Iterable[Pose], frame: CloudFrame | None) -> PointCloud:
    """A cloud in another frame, by the transforms that its source knows; None leaves it.

    Args:
        cloud: the cloud.
        tree: `T_parent_child` at the time of the cloud.
        frame: where it is wanted.

    Raises:
        CalibrationField: no transforms lead there.
    """
    if frame is None or frame == cloud.frame:
        return cloud
    tree = tuple(tree)
    T_frame_cloud = chain(tree, frame, cloud.frame)
    if T_frame_cloud is None:
        known = sorted({name for pose in tree for name in (pose.dst, pose.src)})
        raise CalibrationField(
            f"no transforms from {cloud.frame!r} to {frame!r}",
            want=f"one of {', '.join({cloud.frame: None, **dict.fromkeys(known)})}",
            fix="Leave out --frame to keep clouds as they are.",
            where="tf",
        )
    return carried(cloud, T_frame_cloud)


def carried(cloud: PointCloud, T_frame_cloud: Pose) -> PointCloud:
    """A cloud in another frame; in float64 where float32 cannot tell its points apart there.

    Maps in UTM coordinates lie millions of metres from their origin, where float32 has steps of
    half a metre.
    """
    far = np.abs(T_frame_cloud.translation_m).max() > FLOAT32_REACH_M
    if far and cloud.xyz.dtype != np.float64:
        cloud = replace(cloud, xyz=cloud.xyz.astype(np.float64))
    return cloud.transformed(T_frame_cloud)


def common_frame(sights: Sequence[tuple[str, Iterable[Pose]]]) -> CloudFrame | None:
    """The most fixed frame that is above all of some clouds; None where no frame is.

    That is `map` where it is among them: what is above it (`earth`, `utm`) holds no more still, and
    its coordinates are large.

    Args:
        sights: frame and tree (`T_parent_child`) of each cloud, at least one.
    """
    first, *others = (ancestors(tree, frame) for frame, tree in sights)
    shared = [name for name in first if all(name in names for names in others)]
    if not shared:
        return None
    return MAP if MAP in shared else shared[-1]


def is_optical(frame: str) -> bool:
    """Whether a frame of that name has a camera's axes: x right, y down, z forward."""
    return _OPTICAL.fullmatch(frame) is not None


def turned_forward(cloud: PointCloud) -> PointCloud:
    """The cloud with x forward, y left, z up; only one in a camera's axes is turned."""
    if not is_optical(cloud.frame):
        return cloud
    return cloud.transformed(
        Pose.from_rotation(BASE_LINK, cloud.frame, R_BODY_OPTICAL, np.zeros(3))
    )
