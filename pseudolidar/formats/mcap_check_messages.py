"""Checks of the messages in a recording: stamps, transforms, clouds, images."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from mcap.records import Schema

from pseudolidar.errors import RecordingError
from pseudolidar.formats.mcap_points import NUMERIC_TYPES
from pseudolidar.formats.mcap_records import RawMessage, broken
from pseudolidar.formats.timestamps import NS_PER_S

# A quaternion stored as float64 is a unit to rounding; viewers normalise, but refuse zero.
UNIT_TOLERANCE = 1e-6

BYTES_OF_TYPE = {number: int(kind[2:]) for kind, number in NUMERIC_TYPES.items()}
# Bytes of a pixel by encoding of `foxglove.RawImage`.
BYTES_OF_ENCODING = {
    "mono8": 1,
    "8UC1": 1,
    "mono16": 2,
    "16UC1": 2,
    "32FC1": 4,
    "rgb8": 3,
    "bgr8": 3,
    "8UC3": 3,
    "rgba8": 4,
    "bgra8": 4,
}
# First and last bytes of encoded images.
IMAGE_ENDS = {
    "jpeg": (b"\xff\xd8\xff", b"\xff\xd9"),
    "png": (b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"),
}


@dataclass
class ChannelCheck:
    """A channel while its messages are checked.

    Args:
        topic: its topic.
        schema: name of its schema.
        kind: class of its messages, or None where they cannot be read here.
        log_time_ns: time of its last message.
        stamp_ns: stamp within its last message.
    """

    topic: str
    schema: str
    kind: Any
    log_time_ns: int = 0
    stamp_ns: int = 0


def message_class(schema: Schema, offset: int) -> Any:
    """The class that a protobuf schema describes, built from the file alone.

    Raises:
        RecordingError: the schema lacks a file that it imports, or the message.
    """
    pool = DescriptorPool()
    try:
        files = {file.name: file for file in FileDescriptorSet.FromString(schema.data).file}

        def add(name: str) -> None:
            file = files.pop(name, None)
            if file is not None:
                for imported in file.dependency:
                    add(imported)
                pool.Add(file)

        while files:
            add(next(iter(files)))
        return GetMessageClass(pool.FindMessageTypeByName(schema.name))
    except (TypeError, KeyError, DecodeError) as error:
        raise broken(f"schema {schema.name!r} is not complete ({error})", offset) from error


class MessageChecks:
    """Checks messages in the order of the file, and the frames that they name at its end."""

    def __init__(self) -> None:
        self.start_ns = self.end_ns = 0
        # Parent of each child, and where each frame is used outside of transforms.
        self._parents: dict[str, str] = {}
        self._used: dict[str, str] = {}

    def check(self, channel: ChannelCheck, message: RawMessage) -> None:
        """Check one message.

        Raises:
            RecordingError: names the topic.
        """
        time_ns = message.log_time_ns
        if time_ns <= 0 or time_ns < channel.log_time_ns:
            raise _wrong(channel, f"time {time_ns} ns after {channel.log_time_ns} ns")
        channel.log_time_ns = time_ns
        self.start_ns = min(self.start_ns, time_ns) if self.end_ns else time_ns
        self.end_ns = max(self.end_ns, time_ns)
        if channel.kind is None:
            return
        try:
            content = channel.kind.FromString(message.data)
        except DecodeError as error:
            raise _wrong(channel, f"a message that is no {channel.schema} ({error})") from error
        try:
            self._check_stamp(channel, content)
            self._check_content(channel, content)
        except (AttributeError, TypeError) as error:
            # The class comes from the file: it may have other fields than its name promises.
            raise _wrong(channel, f"a schema that is not that of Foxglove ({error})") from error

    def finish(self) -> None:
        """Check that transforms form one tree that has every frame in use.

        Raises:
            RecordingError: names the frames.
        """
        if not self._parents:
            return
        roots = sorted({self._root(frame) for frame in self._parents})
        if len(roots) != 1:
            raise RecordingError(f"transforms with roots {', '.join(roots)}", want="one root")
        for frame, topic in self._used.items():
            if frame not in self._parents and frame not in roots:
                known = ", ".join(sorted({*self._parents, *roots}))
                raise RecordingError(
                    f"frame {frame!r} that no transform names",
                    want=f"one of {known}",
                    where=topic,
                )

    def _root(self, frame: str) -> str:
        seen = [frame]
        while seen[-1] in self._parents:
            seen.append(self._parents[seen[-1]])
            if seen[-1] in seen[:-1]:
                raise RecordingError(f"transforms in a circle: {' > '.join(seen)}", want="a tree")
        return seen[-1]

    def _check_stamp(self, channel: ChannelCheck, content: Any) -> None:
        if "timestamp" not in content.DESCRIPTOR.fields_by_name:
            return
        stamp_ns = content.timestamp.seconds * NS_PER_S + content.timestamp.nanos
        if stamp_ns <= 0 or stamp_ns < channel.stamp_ns:
            raise _wrong(channel, f"stamp {stamp_ns} ns after {channel.stamp_ns} ns")
        channel.stamp_ns = stamp_ns

    def _check_content(self, channel: ChannelCheck, content: Any) -> None:
        match channel.schema:
            case "foxglove.FrameTransforms":
                for transform in content.transforms:
                    self._check_transform(channel, transform)
            case "foxglove.PointCloud":
                _check_cloud(channel, content)
            case "foxglove.RawImage":
                _check_raw_image(channel, content)
            case "foxglove.CompressedImage":
                _check_compressed_image(channel, content)
            case "foxglove.CameraCalibration":
                _check_calibration(channel, content)
            case "foxglove.SceneUpdate":
                for entity in content.entities:
                    self._used.setdefault(entity.frame_id, channel.topic)
        if "frame_id" in content.DESCRIPTOR.fields_by_name:
            self._used.setdefault(content.frame_id, channel.topic)

    def _check_transform(self, channel: ChannelCheck, transform: Any) -> None:
        parent, child = transform.parent_frame_id, transform.child_frame_id
        if self._parents.setdefault(child, parent) != parent:
            both = f"{parent!r} and {self._parents[child]!r}"
            raise _wrong(channel, f"frame {child!r} with the parents {both}")
        _check_unit(channel, transform.rotation)
        self._check_stamp(channel, transform)


def _check_unit(channel: ChannelCheck, q: Any) -> None:
    norm = math.hypot(q.x, q.y, q.z, q.w)
    if not abs(norm - 1) <= UNIT_TOLERANCE:
        raise _wrong(channel, f"a quaternion of norm {norm:g}")


def _check_cloud(channel: ChannelCheck, cloud: Any) -> None:
    _check_unit(channel, cloud.pose.orientation)
    end = 0
    for column in cloud.fields:
        size = BYTES_OF_TYPE.get(column.type)
        if size is None:
            raise _wrong(channel, f"field {column.name!r} without a type")
        if column.offset < end or column.offset + size > cloud.point_stride:
            raise _wrong(channel, f"field {column.name!r} at byte {column.offset} of the point")
        end = column.offset + size
    names = [column.name for column in cloud.fields]
    if len(set(names)) != len(names) or not {"x", "y", "z"} <= set(names):
        raise _wrong(channel, f"fields {', '.join(names)}")
    size = len(cloud.data)
    if size % cloud.point_stride:
        raise _wrong(channel, f"{size} bytes of points of {cloud.point_stride} bytes")


def _check_raw_image(channel: ChannelCheck, image: Any) -> None:
    pixel = BYTES_OF_ENCODING.get(image.encoding)
    if pixel is None:
        raise _wrong(channel, f"encoding {image.encoding!r}")
    if image.step < image.width * pixel or len(image.data) != image.step * image.height:
        size = f"{image.width}x{image.height} pixels, {image.step} bytes a row"
        raise _wrong(channel, f"{len(image.data)} bytes for {size}")


def _check_compressed_image(channel: ChannelCheck, image: Any) -> None:
    if image.format not in IMAGE_ENDS:
        return
    first, last = IMAGE_ENDS[image.format]
    if not (image.data.startswith(first) and image.data.endswith(last)):
        raise _wrong(channel, f"{len(image.data)} bytes that are no whole {image.format}")


def _check_calibration(channel: ChannelCheck, camera: Any) -> None:
    sizes = len(camera.K), len(camera.R), len(camera.P)
    if sizes != (9, 9, 12) or not camera.K[0] > 0:
        raise _wrong(channel, f"K, R, P of {sizes} numbers, focal length {camera.K[:1]}")


def _wrong(channel: ChannelCheck, got: str) -> RecordingError:
    return RecordingError(
        got,
        want=f"a sound {channel.schema}",
        where=f"{channel.topic} at {channel.log_time_ns} ns",
    )
