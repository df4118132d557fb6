"""Facts to check of Foxglove messages, whose classes come from the file itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from mcap.records import Schema

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
from pseudolidar.formats.mcap.points import NUMERIC_TYPES
from pseudolidar.formats.mcap.records import broken
from pseudolidar.formats.timestamps import NS_PER_S

BYTES_OF_TYPE = {number: int(kind[2:]) for kind, number in NUMERIC_TYPES.items()}


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


def foxglove_facts(schema: str, content: Any) -> Iterator[Fact]:
    """The facts of a message."""
    names = content.DESCRIPTOR.fields_by_name
    if "timestamp" in names:
        yield _stamp(content)
    match schema:
        case "foxglove.FrameTransforms":
            for transform in content.transforms:
                yield Edge(transform.parent_frame_id, transform.child_frame_id)
                yield _rotation(transform.rotation)
                yield _stamp(transform)
        case "foxglove.PointCloud":
            yield _rotation(content.pose.orientation)
            fields = ((f.name, f.offset, BYTES_OF_TYPE.get(f.type)) for f in content.fields)
            yield CloudLayout(tuple(fields), content.point_stride, len(content.data))
        case "foxglove.CompressedPointCloud":
            yield _rotation(content.pose.orientation)
        case "foxglove.RawImage":
            size = content.width, content.height, content.step, len(content.data)
            yield ImageLayout(content.encoding, *size)
        case "foxglove.CompressedImage":
            yield EncodedImage(content.format, content.data)
        case "foxglove.CameraCalibration":
            yield CameraNumbers(tuple(content.K), tuple(content.R), tuple(content.P))
        case "foxglove.PoseInFrame":
            yield _rotation(content.pose.orientation)
        case "foxglove.PosesInFrame":
            for pose in content.poses:
                yield _rotation(pose.orientation)
        case "foxglove.SceneUpdate":
            for entity in content.entities:
                yield Used(entity.frame_id)
    if "frame_id" in names:
        yield Used(content.frame_id)


def _stamp(content: Any) -> Stamp:
    return Stamp(content.timestamp.seconds * NS_PER_S + content.timestamp.nanos)


def _rotation(q: Any) -> Rotation:
    return Rotation(math.hypot(q.x, q.y, q.z, q.w))
