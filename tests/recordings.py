"""Recordings as other programs write them: ROS 2 bags by rosbags, MCAP by its own writers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

from pseudolidar.formats.image import encode_png
from pseudolidar.geometry.frames import frame_tree
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose

ROS = get_typestore(Stores.ROS2_HUMBLE)
TYPES = ROS.types
LEFT, RIGHT = "left_optical", "right_optical"
NAMES = {"camera_left": LEFT, "camera_right": RIGHT, "velodyne": "velo_link"}
POINT_TYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
# Bags file messages when they arrive, a little after their stamps.
DELAY_NS = 3_000_000


def stamp(time_ns: int) -> Any:
    return TYPES["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)


def header(time_ns: int, frame: str) -> Any:
    return TYPES["std_msgs/msg/Header"](stamp(time_ns), frame)


def ros_image(pixels: np.ndarray, time_ns: int, frame: str, encoding: str) -> Any:
    data = np.ascontiguousarray(pixels)
    return TYPES["sensor_msgs/msg/Image"](
        header(time_ns, frame),
        data.shape[0],
        data.shape[1],
        encoding,
        0,
        data.strides[0],
        data.reshape(-1).view(np.uint8),
    )


def ros_compressed(data: bytes, time_ns: int, frame: str, kind: str = "png") -> Any:
    message = TYPES["sensor_msgs/msg/CompressedImage"]
    return message(header(time_ns, frame), kind, np.frombuffer(data, np.uint8))


def ros_camera(
    K: np.ndarray,
    P: np.ndarray,
    size: tuple[int, int],
    time_ns: int,
    frame: str,
    D: Sequence[float] = (0.0,) * 5,
) -> Any:
    roi = TYPES["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return TYPES["sensor_msgs/msg/CameraInfo"](
        header(time_ns, frame),
        size[1],
        size[0],
        "plumb_bob",
        np.array(D, np.float64),
        K.ravel().astype(np.float64),
        np.eye(3).ravel(),
        P.ravel().astype(np.float64),
        0,
        0,
        roi,
    )


def ros_cloud(
    records: np.ndarray,
    time_ns: int,
    frame: str,
    *,
    shape: tuple[int, int] | None = None,
    row_padding: int = 0,
    big_endian: bool = False,
    fields: Iterable[Any] | None = None,
) -> Any:
    """A PointCloud2 of a structured array; its gaps are the padding."""
    height, width = shape or (1, len(records))
    dtype = records.dtype
    if fields is None:
        fields = []
        for name in dtype.names or ():
            base, offset = dtype.fields[name][:2]
            kind, count = base.subdtype or (base, (1,))
            point_field = TYPES["sensor_msgs/msg/PointField"]
            fields.append(point_field(name, offset, POINT_TYPES[kind.str[1:]], count[0]))
    data = np.ascontiguousarray(records).view(np.uint8).reshape(height, -1)
    data = np.pad(data, ((0, 0), (0, row_padding)))
    return TYPES["sensor_msgs/msg/PointCloud2"](
        header(time_ns, frame),
        height,
        width,
        list(fields),
        big_endian,
        dtype.itemsize,
        data.shape[1],
        data.reshape(-1),
        bool(np.isfinite(records["x"]).all()) if len(records) else True,
    )


def ros_transforms(poses: Iterable[Pose], time_ns: int) -> Any:
    found = []
    for pose in poses:
        w, x, y, z = quaternion_wxyz(pose.matrix[:3, :3])
        transform = TYPES["geometry_msgs/msg/Transform"](
            TYPES["geometry_msgs/msg/Vector3"](*pose.translation_m),
            TYPES["geometry_msgs/msg/Quaternion"](x, y, z, w),
        )
        parent, child = (NAMES.get(name, name) for name in (pose.dst, pose.src))
        stamped = TYPES["geometry_msgs/msg/TransformStamped"]
        found.append(stamped(header(time_ns, parent), child, transform))
    return TYPES["tf2_msgs/msg/TFMessage"](found)


def scan_records(scan: LidarScan) -> np.ndarray:
    """A Velodyne's records with gaps, as drivers write them."""
    dtype = np.dtype(
        {
            "names": ["x", "y", "z", "intensity"],
            "formats": ["<f4"] * 4,
            "offsets": [0, 4, 8, 16],
            "itemsize": 32,
        }
    )
    records = np.zeros(len(scan), dtype)
    for axis, name in enumerate("xyz"):
        records[name] = scan.xyz[:, axis]
    records["intensity"] = scan.reflectance
    return records


def ros2_messages(frames: Iterable[StereoFrame], *, raw: bool = False):
    """(topic, message, file time) of a drive, as a car would record it."""
    for number, frame in enumerate(frames):
        time_ns, rig = frame.timestamp_ns, frame.rig
        filed_ns = time_ns + DELAY_NS
        moving = [pose for pose in frame_tree(rig, frame.pose) if pose.src == "base_link"]
        fixed = [pose for pose in frame_tree(rig, frame.pose) if pose.src != "base_link"]
        if number == 0:
            yield "/tf_static", ros_transforms(fixed, time_ns), filed_ns
        yield "/tf", ros_transforms(moving, time_ns), filed_ns
        eyes = (("left", LEFT, frame.left, rig.P_left), ("right", RIGHT, frame.right, rig.P_right))
        for side, name, pixels, P in eyes:
            place = f"/stereo/{side}"
            info = ros_camera(rig.left.K, P, rig.left.size_px, time_ns, name)
            yield f"{place}/camera_info", info, filed_ns
            if raw:
                encoding = "mono8" if pixels.ndim == 2 else "rgb8"
                yield f"{place}/image_rect", ros_image(pixels, time_ns, name, encoding), filed_ns
            else:
                packed = ros_compressed(encode_png(pixels), time_ns, name)
                yield f"{place}/image_rect/compressed", packed, filed_ns
        if frame.scan is not None:
            cloud = ros_cloud(scan_records(frame.scan), frame.scan.timestamp_ns, "velo_link")
            yield "/velodyne_points", cloud, filed_ns


def write_ros2_bag(
    folder: Path, messages: Iterable[tuple[str, Any, int]], storage: str = "sqlite3"
) -> Path:
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Rosbag2Writer(folder, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, message, filed_ns in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS)
            writer.write(connections[topic], filed_ns, ROS.serialize_cdr(message, kind))
    return folder
