"""The way and the map in recordings of both profiles, read back by other people's code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoder
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder

from pseudolidar.formats.mcap.content import McapContent, ProfileName
from pseudolidar.formats.mcap.frame import pack_frame
from pseudolidar.formats.mcap.items import Way
from pseudolidar.formats.mcap.log import McapLog
from pseudolidar.formats.mcap.messages import frame_messages, path_messages
from pseudolidar.formats.mcap.prolog import describe_recording
from pseudolidar.geometry.frames import BASE_LINK, MAP
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

from .test_messages import TIME_NS, full_frame

STEP_NS = 100_000_000


def way() -> Way:
    poses = tuple(
        Pose.from_rotation(MAP, BASE_LINK, np.eye(3), np.array([float(step), 0.0, 0.5]))
        for step in range(3)
    )
    return Way(poses, tuple(TIME_NS + STEP_NS * (step - 2) for step in range(3)))


def some_map() -> PointCloud:
    xyz = np.arange(12, dtype=np.float32).reshape(4, 3)
    rgb = np.full((4, 3), 7, np.uint8)
    return PointCloud(xyz, MAP, rgb=rgb, sigma_m=np.full(4, 0.25, np.float32))


def recorded(path: Path, profile: ProfileName) -> dict[str, Any]:
    """Written, checked as every recording is, and read by other people's code."""
    content = McapContent(profile=profile)
    prolog = describe_recording(
        version="0", settings="", calibration="{}", matcher="", source="a", content=content
    )
    messages = (
        *frame_messages(full_frame(), content=content),
        *path_messages(way(), some_map(), timestamp_ns=TIME_NS, content=content),
    )
    with McapLog(path, prolog) as log:
        log.append(pack_frame(messages, index=42))
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[ProtobufDecoder(), Ros2Decoder()])
        return {
            channel.topic: (schema.name, message)
            for schema, channel, _, message in reader.iter_decoded_messages()
            if schema is not None
        }


def test_foxglove_has_the_way_and_the_map(tmp_path: Path) -> None:
    found = recorded(tmp_path / "a.mcap", "foxglove")
    name, path = found["/path"]
    assert (name, path.frame_id) == ("foxglove.PosesInFrame", "map")
    assert [pose.position.x for pose in path.poses] == [0.0, 1.0, 2.0]
    assert {pose.orientation.w for pose in path.poses} == {1.0}
    name, pose = found["/pose"]
    assert (name, pose.frame_id, pose.pose.position.x) == ("foxglove.PoseInFrame", "map", 5.0)
    name, points = found["/map/points"]
    assert (name, points.frame_id) == ("foxglove.PointCloud", "map")
    assert len(points.data) == 4 * points.point_stride


def test_ros2_has_the_way_and_the_map(tmp_path: Path) -> None:
    found = recorded(tmp_path / "a.mcap", "ros2")
    name, path = found["/path"]
    assert (name, path.header.frame_id) == ("nav_msgs/msg/Path", "map")
    assert [placed.pose.position.x for placed in path.poses] == [0.0, 1.0, 2.0]
    stamps = [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in path.poses]
    assert stamps == list(way().stamps_ns)
    name, points = found["/map/points"]
    assert (name, points.width, points.header.frame_id) == ("sensor_msgs/msg/PointCloud2", 4, "map")
