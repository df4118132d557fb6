"""From a channel to what decodes its messages: one table of all schemas and encodings."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from google.protobuf.message import DecodeError
from mcap.records import Schema

from pseudolidar.errors import PseudolidarError, RecordingError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.facts_foxglove import message_class
from pseudolidar.formats.recordings import foxglove_decode
from pseudolidar.formats.recordings.message_store import CDR, JSON, PROTOBUF, ROS1, Channel
from pseudolidar.formats.recordings.messages import Message
from pseudolidar.formats.ros import decode as ros_decode
from pseudolidar.formats.ros.layout import Layout, parse_layout, plain_name, standard_layout
from pseudolidar.formats.ros.serialized import decode_cdr, decode_ros1
from pseudolidar.formats.timestamps import NS_PER_S

Kind = Literal["picture", "camera", "cloud", "transforms", "pose", "mark"]
KINDS: Mapping[str, Kind] = {
    "foxglove.CompressedImage": "picture",
    "foxglove.RawImage": "picture",
    "foxglove.CameraCalibration": "camera",
    "foxglove.PointCloud": "cloud",
    "foxglove.CompressedPointCloud": "cloud",
    "foxglove.FrameTransforms": "transforms",
    "foxglove.FrameTransform": "transforms",
    "foxglove.PoseInFrame": "pose",
    "foxglove.Odometry": "pose",
    "foxglove.Log": "mark",
    "sensor_msgs/CompressedImage": "picture",
    "sensor_msgs/Image": "picture",
    "sensor_msgs/CameraInfo": "camera",
    "sensor_msgs/PointCloud2": "cloud",
    "tf2_msgs/TFMessage": "transforms",
    "tf/tfMessage": "transforms",
    "geometry_msgs/TransformStamped": "transforms",
    "geometry_msgs/PoseStamped": "pose",
    "geometry_msgs/PoseWithCovarianceStamped": "pose",
    "nav_msgs/Odometry": "pose",
    "rcl_interfaces/Log": "mark",
}
# Key of the stamp in Foxglove's messages, on the wire: field 1, length-delimited.
_STAMP_KEY = 1 << 3 | 2


@dataclass(frozen=True)
class Decoder:
    """Decodes the messages of one channel.

    Args:
        channel: the channel.
        own: whether this package wrote the recording.
        limits: caps on clouds.
    """

    channel: Channel
    own: bool = False
    limits: Limits = DEFAULT_LIMITS

    def __call__(self, data: bytes | memoryview) -> Message:
        """What a message says.

        Raises:
            RecordingError: it is not what its schema says; names the topic.
            PseudolidarError: what is in it cannot be: a cloud that contradicts itself.
        """
        try:
            values, decode, is_cloud = _values_of(self.channel, data)
            return decode(values, own=self.own, limits=self.limits) if is_cloud else decode(values)
        except PseudolidarError as error:
            raise error.located(self.channel.topic) from error.__cause__
        except (
            DecodeError,
            ValueError,
            AttributeError,
            TypeError,
            KeyError,
            struct.error,
        ) as error:
            raise RecordingError(
                f"a message that is no {self.channel.schema} ({error})",
                want="what its schema says",
                where=self.channel.topic,
            ) from error


def kind_of(channel: Channel) -> Kind | None:
    """What the messages of a channel are about; None where they cannot be read."""
    return None if refusal(channel) else KINDS[plain_name(channel.schema)]


def refusal(channel: Channel) -> str:
    """Why the messages of a channel are left out, "" where they are not."""
    if plain_name(channel.schema) not in KINDS:
        return f"schema {channel.schema or 'unknown'}"
    try:
        _reader(channel)
    except (ValueError, RecordingError) as error:
        got = error.got if isinstance(error, RecordingError) else str(error)
        return f"schema {channel.schema} in {channel.encoding or 'no encoding'}: {got}"
    return ""


def stamp_in_head(channel: Channel, head: bytes | memoryview) -> int | None:
    """Time of a message by its first 32 bytes or more, None where it is not among them."""
    name = plain_name(channel.schema)
    if channel.encoding == PROTOBUF and len(head) > 2 and head[0] == _STAMP_KEY:
        return _protobuf_stamp(bytes(head[2 : 2 + head[1]])) if head[1] < len(head) - 2 else None
    if channel.encoding == CDR and (
        name in ros_decode.DECODERS or name in ros_decode.CLOUD_DECODERS
    ):
        first = _layout(channel).fields[0]
        if isinstance(first.kind, Layout) and first.kind.name == "std_msgs/Header":
            return _header_stamp(bytes(head), at=4)
    return None


def _header_stamp(head: bytes, at: int) -> int | None:
    order = ">" if head[1:2] == b"\0" else "<"
    if len(head) < at + 8:
        return None
    seconds, ns = struct.unpack_from(f"{order}iI", head, at)
    return int(seconds) * NS_PER_S + int(ns)


def _protobuf_stamp(data: bytes) -> int | None:
    from google.protobuf.timestamp_pb2 import Timestamp

    try:
        stamp = Timestamp.FromString(data)
    except DecodeError:
        return None
    return int(stamp.seconds) * NS_PER_S + int(stamp.nanos)


def _values_of(
    channel: Channel, data: bytes | memoryview
) -> tuple[Any, Callable[..., Message], bool]:
    name = plain_name(channel.schema)
    values = _reader(channel)(data)
    for decoders, clouds in (
        (foxglove_decode.DECODERS, foxglove_decode.CLOUD_DECODERS),
        (ros_decode.DECODERS, ros_decode.CLOUD_DECODERS),
    ):
        if name in clouds:
            return values, clouds[name], True
        if name in decoders:
            return values, decoders[name], False
    raise ValueError(f"no decoder of {name}")


@functools.lru_cache(maxsize=256)
def _reader(channel: Channel) -> Callable[[bytes | memoryview], Any]:
    """Bytes to values by name.

    Raises:
        ValueError, RecordingError: the encoding or the schema is not one that is known.
    """
    foxglove = channel.schema.startswith("foxglove.")
    if channel.encoding == PROTOBUF and channel.definition_encoding == PROTOBUF and foxglove:
        schema = Schema(
            id=1, name=channel.schema, encoding=PROTOBUF, data=bytes(channel.definition)
        )
        return message_class(schema, 0).FromString  # type: ignore[no-any-return]
    if channel.encoding == JSON and foxglove:
        return foxglove_decode.json_values
    if channel.encoding == CDR and not foxglove:
        layout = _layout(channel)
        return lambda data: decode_cdr(layout, data)
    if channel.encoding == ROS1 and not foxglove:
        layout = _layout(channel)
        return lambda data: decode_ros1(layout, data)
    raise ValueError("messages of this encoding are not read")


@functools.lru_cache(maxsize=256)
def _layout(channel: Channel) -> Layout:
    """By the definition in the recording; of standard types in IDL or without one, as they are."""
    if channel.definition_encoding in ("ros2msg", "ros1msg"):
        return parse_layout(channel.schema, channel.definition.decode("utf-8", "replace"))
    layout = standard_layout(channel.schema)
    if layout is None:
        raise ValueError(f"no definition ({channel.definition_encoding or 'none is recorded'})")
    return layout
