from __future__ import annotations

import time

import numpy as np
import pytest

from pseudolidar.formats.ros.layout import parse_layout, standard_layout
from pseudolidar.formats.ros.ros2_definitions import DEFINITIONS
from pseudolidar.formats.ros.serialized import decode_cdr, decode_ros1
from tests.recordings import ROS, TYPES, header

TIME_NS = 1_600_000_000_000_000_001


KNOWN = [name for name in DEFINITIONS if name.replace("/", "/msg/") in ROS.fielddefs]


@pytest.mark.parametrize("name", KNOWN)
def test_standard_layouts_are_those_of_rosbags(name: str) -> None:
    full = name.replace("/", "/msg/")
    text, _ = ROS.generate_msgdef(full, ros_version=2)
    assert parse_layout(full, text) == standard_layout(full)


def test_values_of_a_nested_message_are_those_that_were_written() -> None:
    message = TYPES["geometry_msgs/msg/PoseWithCovarianceStamped"](
        header(TIME_NS, "map"),
        TYPES["geometry_msgs/msg/PoseWithCovariance"](
            TYPES["geometry_msgs/msg/Pose"](
                TYPES["geometry_msgs/msg/Point"](1.5, -2.0, 3.25),
                TYPES["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8),
            ),
            np.arange(36.0),
        ),
    )
    text, _ = ROS.generate_msgdef(message.__msgtype__, ros_version=2)
    data = bytes(ROS.serialize_cdr(message, message.__msgtype__))
    layout = parse_layout(message.__msgtype__, text)
    found = decode_cdr(layout, data)
    assert (found.header.frame_id, found.header.stamp.nanosec) == ("map", 1)
    assert found.pose.pose.orientation.w == 0.8
    np.testing.assert_array_equal(found.pose.covariance, np.arange(36.0))
    big = bytes(ROS.serialize_cdr(message, message.__msgtype__, little_endian=False))
    other = decode_cdr(layout, big)
    assert (other.header, other.pose.pose) == (found.header, found.pose.pose)
    np.testing.assert_array_equal(other.pose.covariance, found.pose.covariance)
    for cut in range(len(data)):
        with pytest.raises(ValueError, match="bytes"):
            decode_cdr(layout, data[:cut])


def test_constants_defaults_bounds_and_comments() -> None:
    text = (
        "# a comment\nuint8 A=1\nstring B = with = signs\nint32 count 7  # default\n"
        "string<=5 name\nfloat32[<=3] few\nuint8[2] two\nbool flag true\n"
        "================\nMSG: pkg/Other\nint8 x\n"
    )
    layout = parse_layout("pkg/msg/Type", text)
    assert [field.name for field in layout.fields] == ["count", "name", "few", "two", "flag"]
    assert [field.count for field in layout.fields] == [None, None, None, 2, None]
    data = b"\0\1\0\0" + np.array([5], "<i4").tobytes() + b"\2\0\0\0a\0" + bytes(2)
    data += np.array([1], "<u4").tobytes() + np.array([2.5], "<f4").tobytes() + b"\7\x08\1"
    found = decode_cdr(layout, data)
    assert (found.count, found.name, found.few.tolist()) == (5, "a", [2.5])
    assert (found.two.tolist(), found.flag) == ([7, 8], 1)


def test_ros1_has_no_gaps() -> None:
    layout = parse_layout(
        "pkg/Type",
        "uint8 a\ntime t\nfloat64 b\nHeader header\n"
        + "=" * 80
        + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n",
    )
    data = b"\1" + np.array([3, 4], "<u4").tobytes() + np.array([2.5], "<f8").tobytes()
    data += np.array([9, 5, 6, 3], "<u4").tobytes() + b"abc"
    found = decode_ros1(layout, data)
    assert (found.a, found.t.secs, found.t.nsecs, found.b) == (1, 3, 4, 2.5)
    assert (found.header.seq, found.header.frame_id) == (9, "abc")


@pytest.mark.parametrize(
    "text",
    [
        "pkg/Type self",
        "Unknown x",
        "int32",
        "int32 x\n====\nint8 y",
        "pkg/A a\n===\nMSG: pkg/A\npkg/B b\n===\nMSG: pkg/B\npkg/A a",
    ],
)
def test_definitions_that_cannot_be(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_layout("pkg/Type", text)


def test_definitions_that_explode_are_refused_at_once() -> None:
    parts = ["L0 a\nL0 b"]
    for level in range(15):
        fields = "\n".join(f"pkg/L{level + 1} f{i}" for i in range(20))
        parts.append(f"MSG: pkg/L{level}\n{fields}")
    parts.append("MSG: pkg/L15\nint8 x")
    began_s = time.process_time()
    with pytest.raises(ValueError, match=r"values in|holds itself"):
        parse_layout("pkg/Type", "\n======\n".join(parts))
    assert time.process_time() - began_s < 1


def test_lengths_that_lie_are_refused() -> None:
    layout = parse_layout("pkg/Type", "string[] names\nfloat64[] values")
    for data in (
        b"\0\1\0\0\xff\xff\xff\xff",
        b"\0\1\0\0\1\0\0\0\xff\xff\xff\x7fab",
        b"\0\1\0\0\0\0\0\0\xff\xff\xff\x1f" + bytes(64),
        b"\0\3\0\0" + bytes(8),
        b"",
    ):
        with pytest.raises(ValueError, match=r"."):
            decode_cdr(layout, data)
