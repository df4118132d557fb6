"""Facts to check of ROS 2 messages, decoded by other people's code from the file's own schemas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from pseudolidar.formats.mcap.facts import (
    CameraNumbers,
    CloudLayout,
    Edge,
    EncodedImage,
    Fact,
    ImageLayout,
    Rotation,
    Stamp,
    Used,
)
from pseudolidar.formats.mcap.ros2 import CDR, ROS2
from pseudolidar.formats.ros.ros2_messages import POINT_FIELD_TYPES
from pseudolidar.formats.timestamps import NS_PER_S

BYTES_OF_TYPE = {number: int(kind[2:]) for kind, number in POINT_FIELD_TYPES.items()}
_OURS = frozenset((topic.schema.name, topic.schema.data) for topic in ROS2.topics)


def ros2_decoder(schema: Schema) -> Callable[[bytes], Any] | None:
    """What decodes messages of a schema; None where it is not of a recording of this package.

    Other programs' messages need not keep the rules that ours do, so they are not judged.
    """
    if (schema.name, schema.data) not in _OURS:
        return None
    decode: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(CDR, schema)
    return decode


def ros2_facts(schema: str, content: Any) -> Iterator[Fact]:
    """The facts of a message."""
    match schema:
        case "tf2_msgs/msg/TFMessage":
            for transform in content.transforms:
                yield Edge(transform.header.frame_id, transform.child_frame_id)
                yield _rotation(transform.transform.rotation)
                yield _stamp(transform.header.stamp)
        case "rcl_interfaces/msg/Log":
            yield _stamp(content.stamp)
        case "visualization_msgs/msg/MarkerArray":
            for marker in content.markers:
                yield from _header(marker)
        case _:
            yield from _header(content)
            yield from _content(schema, content)


def _content(schema: str, content: Any) -> Iterator[Fact]:
    match schema:
        case "sensor_msgs/msg/PointCloud2":
            fields = ((f.name, f.offset, BYTES_OF_TYPE.get(f.datatype)) for f in content.fields)
            yield CloudLayout(tuple(fields), content.point_step, len(content.data))
        case "sensor_msgs/msg/Image":
            yield _image(content)
        case "stereo_msgs/msg/DisparityImage":
            yield _image(content.image)
        case "sensor_msgs/msg/CompressedImage":
            kinds = [kind for kind in ("jpeg", "png") if kind in content.format]
            yield EncodedImage(kinds[0] if kinds else content.format, content.data)
        case "sensor_msgs/msg/CameraInfo":
            yield CameraNumbers(tuple(content.k), tuple(content.r), tuple(content.p))
        case "geometry_msgs/msg/PoseStamped":
            yield _rotation(content.pose.orientation)
        case "nav_msgs/msg/Odometry":
            yield _rotation(content.pose.pose.orientation)
        case "nav_msgs/msg/Path":
            for placed in content.poses:
                yield Used(placed.header.frame_id)  # stamps are those of earlier frames
                yield _rotation(placed.pose.orientation)


def _image(image: Any) -> ImageLayout:
    return ImageLayout(image.encoding, image.width, image.height, image.step, len(image.data))


def _header(content: Any) -> Iterator[Fact]:
    yield _stamp(content.header.stamp)
    yield Used(content.header.frame_id)


def _stamp(stamp: Any) -> Stamp:
    return Stamp(stamp.sec * NS_PER_S + stamp.nanosec)


def _rotation(q: Any) -> Rotation:
    return Rotation(math.hypot(q.x, q.y, q.z, q.w))
