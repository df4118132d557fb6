"""The topics of a recording: fixed identifiers, Foxglove schemas, meaning of the values.

Identifiers are positions in these tuples, the same in every file, so that a frame can be packed
without knowing the frames before it. Append, never reorder.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.records import Channel, Schema

from pseudolidar.errors import StructureError
from pseudolidar.formats.mcap_records import record_bytes
from pseudolidar.structures.disparity import RADIUS_95_PER_SIGMA

PROTOBUF = "protobuf"

DEPTH_MEANING = {
    "unit": "mm",
    "invalid": "0",
    "range": "up to 65.535 m; what is farther is 0 here, and whole in /stereo/disparity",
}
POINTS_MEANING = {
    "unit": "m",
    "sigma_m": "one standard deviation (68 %) along the ray, m",
    "radius_95": f"{RADIUS_95_PER_SIGMA} sigma_m",
    "u, v": "pixel of the left image, centre of the first pixel at (0, 0)",
}


@dataclass(frozen=True)
class Topic:
    """A topic of the recording.

    Args:
        name: topic.
        message: class of its messages.
        meaning: units and conventions, stored with the channel.
    """

    name: str
    message: Any
    meaning: Mapping[str, str] = field(default_factory=dict)


SCHEMAS = (
    Log,
    FrameTransforms,
    CameraCalibration,
    CompressedImage,
    RawImage,
    PointCloud,
    SceneUpdate,
)

FRAME = "/frame"
LOG = "/log"
TRANSFORMS = "/tf"
LEFT_IMAGE, LEFT_CALIBRATION = "/camera/left/image", "/camera/left/calibration"
RIGHT_IMAGE, RIGHT_CALIBRATION = "/camera/right/image", "/camera/right/calibration"
DISPARITY = "/stereo/disparity"
DEPTH, DEPTH_PNG = "/stereo/depth", "/stereo/depth/png"
POINTS = "/stereo/points"
SCAN = "/velodyne/points"
LABELS = "/labels"

DISPARITY_MEANING = {
    "unit": "px",
    "invalid": "NaN",
    "sign": "x_left - x_right",
    "correction": "as matched: a rig's disparity correction is in depth and points only",
}

TOPICS = (
    Topic(FRAME, Log, {"name": "frame id of the source", "sequence": "index in the source"}),
    Topic(LOG, Log),
    Topic(TRANSFORMS, FrameTransforms),
    Topic(LEFT_IMAGE, CompressedImage),
    Topic(LEFT_CALIBRATION, CameraCalibration),
    Topic(RIGHT_IMAGE, CompressedImage),
    Topic(RIGHT_CALIBRATION, CameraCalibration),
    Topic(DISPARITY, RawImage, DISPARITY_MEANING),
    Topic(DEPTH, RawImage, DEPTH_MEANING),
    Topic(DEPTH_PNG, CompressedImage, DEPTH_MEANING),
    Topic(POINTS, PointCloud, POINTS_MEANING),
    Topic(SCAN, PointCloud, {"unit": "m", "intensity": "reflectance 0-1"}),
    Topic(LABELS, SceneUpdate),
)

_IDS = {topic.name: number for number, topic in enumerate(TOPICS, start=1)}


def channel_id(topic: str) -> int:
    """Identifier of a topic in every file.

    Raises:
        StructureError: no such topic.
    """
    try:
        return _IDS[topic]
    except KeyError:
        raise StructureError(
            f"topic {topic!r}", want=f"one of {', '.join(_IDS)}", where="LogMessage.topic"
        ) from None


@functools.cache
def channel_record(number: int) -> bytes:
    """The channel record of a topic's identifier."""
    topic = TOPICS[number - 1]
    return record_bytes(
        Channel(
            id=number,
            topic=topic.name,
            message_encoding=PROTOBUF,
            metadata=dict(topic.meaning),
            schema_id=schema_id(number),
        )
    )


@functools.cache
def schema_record(number: int) -> bytes:
    """The schema record of a schema's identifier, with all files that the schema imports."""
    message = SCHEMAS[number - 1]
    data = descriptor_set(message).SerializeToString(deterministic=True)
    name = message.DESCRIPTOR.full_name
    return record_bytes(Schema(id=number, name=name, encoding=PROTOBUF, data=data))


def schema_id(channel: int) -> int:
    """Identifier of the schema of a channel."""
    return SCHEMAS.index(TOPICS[channel - 1].message) + 1


def descriptor_set(message: Any) -> FileDescriptorSet:
    """Descriptors of a message's file and of everything it imports, imports first."""
    files: dict[str, Any] = {}

    def add(file: Any) -> None:
        for imported in file.dependencies:
            if imported.name not in files:
                add(imported)
        files.setdefault(file.name, file)

    add(message.DESCRIPTOR.file)
    result = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(result.file.add())
    return result
