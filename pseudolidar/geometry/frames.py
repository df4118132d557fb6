"""The tree of coordinate frames: map > odom > base_link > sensors."""

from __future__ import annotations

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose

# Names of REP-105.
MAP, ODOM, BASE_LINK = "map", "odom", "base_link"

# Body axes (x forward, y left, z up) of an optical frame (x right, y down, z forward).
R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def left_in_base_link(rig: StereoRig) -> Pose:
    """`T_base_link_left`: where the left camera is on the body.

    `base_link` is the IMU where its calibration reaches the camera, else the Velodyne, else the
    left camera turned to x forward, y left, z up.
    """
    left = rig.left.frame
    if rig.T_left_velodyne is None:
        return Pose.from_rotation(BASE_LINK, left, R_BODY_OPTICAL, np.zeros(3))
    T_velodyne_left = rig.T_left_velodyne.inverse()
    T_imu_velodyne = None if rig.T_velodyne_imu is None else rig.T_velodyne_imu.inverse()
    T_body_left = T_velodyne_left if T_imu_velodyne is None else T_imu_velodyne @ T_velodyne_left
    return Pose(BASE_LINK, left, T_body_left.matrix)


def on_moved_base(
    pose: Pose | None, motion: BodyMotion | None, T_new_old: Float64
) -> tuple[Pose | None, BodyMotion | None]:
    """Pose and motion of the body where another place on it becomes `base_link`.

    `map` moves with it, so that it still is where `base_link` was when the pose was the identity.

    Args:
        pose: `T_map_base_link`, where it is known.
        motion: of `base_link`, where it is known.
        T_new_old: (4, 4) the old `base_link` in the new one.
    """
    T = Pose(BASE_LINK, BASE_LINK, T_new_old)
    if pose is not None:
        matrix = T.matrix @ pose.matrix @ T.inverse().matrix
        pose = Pose(pose.dst, pose.src, matrix)
    return pose, motion and motion.at(T)


def frame_tree(rig: StereoRig, pose: Pose | None = None) -> tuple[Pose, ...]:
    """All transforms between `map`, `odom`, `base_link`, and the sensors that are calibrated.

    Args:
        rig: names the sensors' frames and places them.
        pose: `T_map_base_link`; without it `map`, `odom` and `base_link` coincide.

    Returns:
        `T_parent_child` of each child, parents first: a tree with the single root `map`. The IMU
        is left out where nothing ties it to the cameras.

    Raises:
        StructureError: the pose is between other frames, or two frames have the same name.
    """
    pose = Pose.identity(MAP, BASE_LINK) if pose is None else pose
    if (pose.dst, pose.src) != (MAP, BASE_LINK):
        raise StructureError(
            f"T_{pose.dst}_{pose.src}", want=f"T_{MAP}_{BASE_LINK}", where="frame_tree"
        )
    T_base_left = left_in_base_link(rig)
    tree = [
        Pose.identity(MAP, ODOM),
        Pose(ODOM, BASE_LINK, pose.matrix),
        *_lidar_and_imu(rig, T_base_left),
        T_base_left,
        T_base_left @ rig.T_right_left.inverse(),
    ]
    names = [MAP, *(child.src for child in tree)]
    if len(set(names)) != len(names):
        raise StructureError(
            f"frames {', '.join(names)}", want="each name once", where="frame_tree"
        )
    return tuple(tree)


def _lidar_and_imu(rig: StereoRig, T_base_left: Pose) -> list[Pose]:
    if rig.T_left_velodyne is None:
        return []
    T_base_velodyne = T_base_left @ rig.T_left_velodyne
    if rig.T_velodyne_imu is None:
        return [_exact(T_base_velodyne)]
    return [T_base_velodyne, _exact(T_base_velodyne @ rig.T_velodyne_imu)]


def _exact(T_base_sensor: Pose) -> Pose:
    """The sensor that is `base_link` itself: identity, without the rounding of the chain."""
    return Pose.identity(T_base_sensor.dst, T_base_sensor.src)


def camera_tree(camera: Camera, pose: Pose | None = None) -> tuple[Pose, ...]:
    """All transforms between `map`, `odom`, `base_link` and the only camera.

    Args:
        camera: on the body where its x, y, z are right, down, forward of it.
        pose: `T_map_base_link`; without it `map`, `odom` and `base_link` coincide.

    Raises:
        StructureError: the pose is between other frames.
    """
    pose = Pose.identity(MAP, BASE_LINK) if pose is None else pose
    if (pose.dst, pose.src) != (MAP, BASE_LINK):
        raise StructureError(
            f"T_{pose.dst}_{pose.src}", want=f"T_{MAP}_{BASE_LINK}", where="camera_tree"
        )
    turned = Pose.from_rotation(BASE_LINK, camera.frame, R_BODY_OPTICAL, np.zeros(3))
    return Pose.identity(MAP, ODOM), Pose(ODOM, BASE_LINK, pose.matrix), turned


def component(tree: tuple[Pose, ...], frame: str) -> tuple[Pose, ...]:
    """Those of the transforms that tie other frames to `frame`, directly or by way of others."""
    names, size = {frame}, 0
    while size < len(names):
        size = len(names)
        for pose in tree:
            if pose.dst in names or pose.src in names:
                names |= {pose.dst, pose.src}
    return tuple(pose for pose in tree if pose.src in names)
