"""Foxglove messages, as protobuf or as JSON, to what they say.

Source: foxglove/schemas, https://docs.foxglove.dev/docs/visualization/message-schemas.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from pseudolidar.formats.limits import Limits
from pseudolidar.formats.mcap.points import NUMERIC_TYPES
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
from pseudolidar.geometry.quaternion import rotation_of
from pseudolidar.structures.pose import Pose

# Light takes a day for as much; damaged numbers are larger, and NaN compares with nothing.
FARTHEST_M = 1e12
CODES: Mapping[int, str] = {int(number): code[1:] for code, number in NUMERIC_TYPES.items()}


def json_values(data: bytes | memoryview) -> SimpleNamespace:
    """A JSON object as values by name; objects within it likewise.

    Raises:
        ValueError: not such an object, or nested too deeply.
    """
    try:
        found = json.loads(bytes(data), object_hook=lambda fields: SimpleNamespace(**fields))
    except RecursionError:
        raise ValueError("JSON that is nested too deeply") from None
    if not isinstance(found, SimpleNamespace):
        raise ValueError("JSON that is no object")
    return found


def encoded_picture(message: Any) -> EncodedPicture:
    """`foxglove.CompressedImage`."""
    return EncodedPicture(
        stamp_of(message), message.frame_id, bytes(_data(message)), str(message.format)
    )


def raw_picture(message: Any) -> RawPicture:
    """`foxglove.RawImage`."""
    return RawPicture(
        stamp_of(message),
        str(message.frame_id),
        int(message.width),
        int(message.height),
        str(message.encoding),
        int(message.step),
        False,
        _data(message),
    )


def camera_info(message: Any) -> CameraInfo:
    """`foxglove.CameraCalibration`."""
    return CameraInfo(
        stamp_of(message),
        str(message.frame_id),
        int(message.width),
        int(message.height),
        str(message.distortion_model),
        np.asarray(message.D, np.float64).reshape(-1),
        column_values(message.K, 9).reshape(3, 3),
        column_values(message.R, 9).reshape(3, 3),
        column_values(message.P, 12).reshape(3, 4),
    )


def cloud(message: Any, *, own: bool, limits: Limits) -> CloudMessage:
    """`foxglove.PointCloud`; its pose in its frame is applied."""
    data, stride = _data(message), int(message.point_stride)
    fields = tuple(
        PackedField(str(field.name), int(field.offset), _code(field.type))
        for field in message.fields
    )
    if stride < 1 or len(data) % stride:
        raise ValueError(f"{len(data)} bytes of points of {stride} bytes")
    count = len(data) // stride
    packed = PackedCloud(
        str(message.frame_id), stamp_of(message), fields, stride, count, 1, len(data), False, data
    )
    found = packed.cloud(own=own, limits=limits)
    T_frame_points = _pose(message.pose, found.frame, found.frame)
    if not np.array_equal(T_frame_points.matrix, np.eye(4)):
        found = found.transformed(T_frame_points)
    return CloudMessage(packed.stamp_ns, found)


def compressed_cloud(message: Any, *, own: bool, limits: Limits) -> CloudMessage:
    """`foxglove.CompressedPointCloud`, format draco."""
    from pseudolidar.formats.recordings.draco_cloud import draco_cloud

    if message.format != "draco":
        raise ValueError(f"format {str(message.format)[:20]!r}, which is not draco")
    stamp_ns, frame = stamp_of(message), str(message.frame_id)
    found = draco_cloud(bytes(_data(message)), frame, stamp_ns, own=own, limits=limits)
    return CloudMessage(stamp_ns, found.transformed(_pose(message.pose, frame, frame)))


def transforms(message: Any) -> Transforms:
    """`foxglove.FrameTransforms`."""
    return Transforms(tuple(_transform(part) for part in message.transforms))


def transform(message: Any) -> Transforms:
    """`foxglove.FrameTransform`."""
    return Transforms((_transform(message),))


def pose(message: Any) -> Transforms:
    """`foxglove.PoseInFrame`: the pose of the body in its frame."""
    frame = str(message.frame_id)
    found = _pose(message.pose, frame, BASE_LINK)
    return Transforms((StampedPose(stamp_of(message), found),))


def odometry(message: Any) -> Transforms:
    """`foxglove.Odometry`."""
    found = _pose(message.pose, str(message.frame_id), str(message.body_frame_id))
    return Transforms((StampedPose(stamp_of(message), found),))


def mark(message: Any) -> Mark:
    """`foxglove.Log` of the topic that marks frames."""
    return Mark(stamp_of(message), str(message.name), str(message.message), str(message.file))


Decode = Callable[[Any], Message]
# By the name of the schema; those of clouds take more than the message.
DECODERS: Mapping[str, Decode] = {
    "foxglove.CompressedImage": encoded_picture,
    "foxglove.RawImage": raw_picture,
    "foxglove.CameraCalibration": camera_info,
    "foxglove.FrameTransforms": transforms,
    "foxglove.FrameTransform": transform,
    "foxglove.PoseInFrame": pose,
    "foxglove.Odometry": odometry,
    "foxglove.Log": mark,
}
CLOUD_DECODERS: Mapping[str, Callable[..., CloudMessage]] = {
    "foxglove.PointCloud": cloud,
    "foxglove.CompressedPointCloud": compressed_cloud,
}


def stamp_of(message: Any) -> int:
    """Time of a message; protobuf and JSON name its parts in two ways."""
    stamp = message.timestamp
    if isinstance(stamp, SimpleNamespace):
        return int(stamp.sec) * NS_PER_S + int(stamp.nsec)
    return int(stamp.seconds) * NS_PER_S + int(stamp.nanos)


def _data(message: Any) -> bytes:
    """Payload of a message; JSON has it as base64."""
    if isinstance(message.data, str):
        return base64.b64decode(message.data, validate=True)
    return bytes(message.data)


def _code(kind: int) -> str:
    if kind not in CODES:
        raise ValueError(f"a field of type {kind}")
    return CODES[kind]


def _transform(part: Any) -> StampedPose:
    t, q = part.translation, part.rotation
    found = _rigid(str(part.parent_frame_id), str(part.child_frame_id), t, q)
    return StampedPose(stamp_of(part), found)


def _pose(given: Any, dst: str, src: str) -> Pose:
    """A pose; one that is not set has a quaternion of zeros and is none at all."""
    q = given.orientation
    if q.x == q.y == q.z == q.w == 0:
        return Pose.identity(dst, src)
    return _rigid(dst, src, given.position, q)


def _rigid(dst: str, src: str, t: Any, q: Any) -> Pose:
    wxyz, t_m = np.array([q.w, q.x, q.y, q.z]), np.array([t.x, t.y, t.z])
    return rigid(dst, src, wxyz, t_m)


def rigid(dst: str, src: str, wxyz: Any, t_m: Any) -> Pose:
    """A pose of a message's numbers.

    Raises:
        ValueError: they are not finite or beyond all measure, or the quaternion is 0.
    """
    numbers = np.concatenate([wxyz, t_m]).astype(np.float64)
    if not (np.abs(numbers).max() <= FARTHEST_M and np.linalg.norm(numbers[:4]) > 0):
        raise ValueError(f"transform {numbers.tolist()}")
    if np.array_equal(numbers[1:4], (0, 0, 0)):
        return Pose.from_rotation(dst, src, np.eye(3), numbers[4:])
    return Pose.from_rotation(dst, src, rotation_of(numbers[:4]), numbers[4:])
