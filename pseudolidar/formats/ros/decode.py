"""ROS messages to what they say: sensor_msgs, tf2_msgs, geometry_msgs, nav_msgs.

Source: ROS 2 common_interfaces; ROS 1 common_msgs, whose camera_info has capital letters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pseudolidar.formats.limits import Limits
from pseudolidar.formats.recordings.foxglove_decode import rigid
from pseudolidar.formats.recordings.messages import (
    CameraInfo,
    CloudMessage,
    EncodedPicture,
    Mark,
    Message,
    RawPicture,
    StampedPose,
    Transforms,
    column_values,
)
from pseudolidar.formats.recordings.packed_cloud import PackedCloud, PackedField
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import BASE_LINK

# sensor_msgs/PointField: these numbers differ from Foxglove's.
CODES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def encoded_picture(message: Any) -> EncodedPicture:
    """`sensor_msgs/CompressedImage`."""
    return EncodedPicture(
        _stamp(message), _frame(message), bytes(message.data), str(message.format)
    )


def raw_picture(message: Any) -> RawPicture:
    """`sensor_msgs/Image`."""
    return RawPicture(
        _stamp(message),
        _frame(message),
        message.width,
        message.height,
        message.encoding,
        message.step,
        bool(message.is_bigendian),
        memoryview(message.data),
    )


def camera_info(message: Any) -> CameraInfo:
    """`sensor_msgs/CameraInfo`."""
    given = {name.lower(): value for name, value in vars(message).items()}
    return CameraInfo(
        _stamp(message),
        _frame(message),
        message.width,
        message.height,
        message.distortion_model,
        np.asarray(given["d"], np.float64),
        column_values(given["k"], 9).reshape(3, 3),
        column_values(given["r"], 9).reshape(3, 3),
        column_values(given["p"], 12).reshape(3, 4),
    )


def cloud(message: Any, *, own: bool, limits: Limits) -> CloudMessage:
    """`sensor_msgs/PointCloud2`."""
    fields = []
    for field in message.fields:
        if field.datatype not in CODES:
            raise ValueError(f"field {field.name[:40]!r} of type {field.datatype}")
        # Some drivers write a count of 0 for one value.
        count = max(field.count, 1)
        fields.append(PackedField(field.name, field.offset, CODES[field.datatype], count))
    packed = PackedCloud(
        _frame(message),
        _stamp(message),
        tuple(fields),
        message.point_step,
        message.width,
        message.height,
        message.row_step or message.width * message.point_step,
        bool(message.is_bigendian),
        memoryview(message.data),
    )
    return CloudMessage(packed.stamp_ns, packed.cloud(own=own, limits=limits))


def transforms(message: Any) -> Transforms:
    """`tf2_msgs/TFMessage`."""
    return Transforms(tuple(_transform(part) for part in message.transforms))


def transform(message: Any) -> Transforms:
    """`geometry_msgs/TransformStamped`."""
    return Transforms((_transform(message),))


def pose(message: Any) -> Transforms:
    """`geometry_msgs/PoseStamped` and `PoseWithCovarianceStamped`: of the body."""
    given = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    return _posed(message, given, BASE_LINK)


def odometry(message: Any) -> Transforms:
    """`nav_msgs/Odometry`."""
    return _posed(message, message.pose.pose, _plain(message.child_frame_id))


def mark(message: Any) -> Mark:
    """`rcl_interfaces/Log` of the topic that marks frames."""
    return Mark(_time(message.stamp), str(message.name), str(message.msg), str(message.file))


Decode = Callable[[Any], Message]
DECODERS: Mapping[str, Decode] = {
    "sensor_msgs/CompressedImage": encoded_picture,
    "sensor_msgs/Image": raw_picture,
    "sensor_msgs/CameraInfo": camera_info,
    "tf2_msgs/TFMessage": transforms,
    "tf/tfMessage": transforms,
    "geometry_msgs/TransformStamped": transform,
    "geometry_msgs/PoseStamped": pose,
    "geometry_msgs/PoseWithCovarianceStamped": pose,
    "nav_msgs/Odometry": odometry,
    "rcl_interfaces/Log": mark,
}
CLOUD_DECODERS: Mapping[str, Callable[..., CloudMessage]] = {"sensor_msgs/PointCloud2": cloud}


def _stamp(message: Any) -> int:
    return _time(message.header.stamp)


def _time(stamp: Any) -> int:
    parts = vars(stamp)
    seconds = parts.get("sec", parts.get("secs", 0))
    return int(seconds) * NS_PER_S + int(parts.get("nanosec", parts.get("nsecs", 0)))


def _frame(message: Any) -> str:
    return _plain(message.header.frame_id)


def _plain(frame: str) -> str:
    """A frame's name without the slash that ROS 1 began them with."""
    return frame.removeprefix("/")


def _transform(part: Any) -> StampedPose:
    t, q = part.transform.translation, part.transform.rotation
    found = rigid(
        _frame(part),
        _plain(part.child_frame_id),
        np.array([q.w, q.x, q.y, q.z]),
        np.array([t.x, t.y, t.z]),
    )
    return StampedPose(_stamp(part), found)


def _posed(message: Any, given: Any, child: str) -> Transforms:
    p, q = given.position, given.orientation
    found = rigid(_frame(message), child, np.array([q.w, q.x, q.y, q.z]), np.array([p.x, p.y, p.z]))
    return Transforms((StampedPose(_stamp(message), found),))
