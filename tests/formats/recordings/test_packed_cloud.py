from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pseudolidar.errors import LimitError, PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.recordings.decoders import Decoder
from pseudolidar.formats.recordings.message_store import CDR, Channel
from pseudolidar.formats.recordings.messages import CloudMessage
from pseudolidar.structures.cloud import PointCloud
from tests.recordings import ROS, TYPES, ros_cloud

TIME_NS = 1_600_000_000_123_456_789
CHANNEL = Channel("/points", "sensor_msgs/msg/PointCloud2", b"", "", CDR)


def decoded(message: Any, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    data = ROS.serialize_cdr(message, message.__msgtype__)
    found = Decoder(CHANNEL, limits=limits)(data)
    assert isinstance(found, CloudMessage)
    assert found.stamp_ns == TIME_NS
    return found.cloud


def records(n: int, fields: list[tuple[str, str]], gap: int = 0) -> np.ndarray:
    rng = np.random.default_rng(n)
    offsets, at = [], gap
    for _, code in fields:
        offsets.append(at)
        at += np.dtype(code).itemsize + gap
    dtype = np.dtype(
        {
            "names": [name for name, _ in fields],
            "formats": [code for _, code in fields],
            "offsets": offsets,
            "itemsize": at,
        }
    )
    made = np.zeros(n, dtype)
    for name, code in fields:
        kind = np.dtype(code)
        if kind.kind == "f":
            made[name] = rng.normal(size=n).astype(kind) * 10
        else:
            limits = np.iinfo(kind)
            made[name] = rng.integers(limits.min, limits.max, n, kind.newbyteorder("="), True)
    return made


XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]


@pytest.mark.parametrize("gap", [0, 4, 3])
def test_every_datatype_with_and_without_gaps(gap: int) -> None:
    kinds = [(f"c{code}", f"<{code}") for code in ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")]
    made = records(30, [*XYZ, *kinds], gap)
    cloud = decoded(ros_cloud(made, TIME_NS, "velo"))
    assert (cloud.frame, cloud.timestamp_ns, cloud.shape) == ("velo", TIME_NS, None)
    np.testing.assert_array_equal(cloud.xyz, np.stack([made[a] for a in "xyz"], axis=1))
    for name, code in kinds:
        assert cloud.extra[name].dtype == np.dtype(code).newbyteorder("=")
        np.testing.assert_array_equal(cloud.extra[name], made[name])


def test_big_endian() -> None:
    made = records(20, [(name, code.replace("<", ">")) for name, code in [*XYZ, ("t", "<f8")]])
    cloud = decoded(ros_cloud(made, TIME_NS, "velo", big_endian=True))
    np.testing.assert_array_equal(cloud.xyz[:, 1], made["y"].astype(np.float32))
    np.testing.assert_array_equal(cloud.extra["t"], made["t"].astype(np.float64))


def test_organised_with_padded_rows_and_holes() -> None:
    made = records(12, XYZ)
    made["x"][5] = np.nan
    cloud = decoded(ros_cloud(made, TIME_NS, "velo", shape=(3, 4), row_padding=7))
    assert cloud.shape == (3, 4)
    np.testing.assert_array_equal(cloud.xyz[:, 2], made["z"])
    assert not cloud.valid[5]
    assert cloud.valid.sum() == 11


def test_double_coordinates_of_a_map() -> None:
    made = records(9, [("x", "<f8"), ("y", "<f8"), ("z", "<f8")])
    made["x"] += 456_789.123_456
    cloud = decoded(ros_cloud(made, TIME_NS, "utm"))
    assert cloud.xyz.dtype == np.float64
    np.testing.assert_array_equal(cloud.xyz[:, 0], made["x"])


@pytest.mark.parametrize("code", ["<f4", "<u4"])
@pytest.mark.parametrize("name", ["rgb", "rgba"])
def test_packed_colours(name: str, code: str) -> None:
    made = records(7, [*XYZ, (name, code)])
    rgb = np.random.default_rng(1).integers(0, 256, (7, 4), np.uint8)
    packed = np.ascontiguousarray(rgb[:, [2, 1, 0, 3]]).view("<u4")[:, 0]
    made[name] = packed.view(code)
    cloud = decoded(ros_cloud(made, TIME_NS, "velo"))
    np.testing.assert_array_equal(cloud.rgb, rgb[:, :3])
    assert ("alpha" in cloud.extra) == (name == "rgba")


def test_intensity_is_ours_only_where_it_means_the_same() -> None:
    made = records(8, [*XYZ, ("intensity", "<f4")])
    made["intensity"] = np.linspace(0, 1, 8)
    cloud = decoded(ros_cloud(made, TIME_NS, "velo"))
    np.testing.assert_array_equal(cloud.intensity, made["intensity"])
    made["intensity"] *= 255
    cloud = decoded(ros_cloud(made, TIME_NS, "velo"))
    assert cloud.intensity is None
    np.testing.assert_array_equal(cloud.extra["intensity"], made["intensity"])


def test_a_field_of_several_values_becomes_several_columns() -> None:
    dtype = np.dtype([*XYZ, ("normal", "<f4", (3,))])
    made = np.zeros(5, dtype)
    made["normal"] = np.arange(15).reshape(5, 3)
    cloud = decoded(ros_cloud(made, TIME_NS, "velo"))
    assert list(cloud.extra) == ["normal_0", "normal_1", "normal_2"]
    np.testing.assert_array_equal(cloud.extra["normal_2"], [2, 5, 8, 11, 14])


def test_names_that_no_file_can_hold_are_made_fit() -> None:
    made = records(3, XYZ)
    field = TYPES["sensor_msgs/msg/PointField"]
    fields = [
        *(field(axis, 4 * i, 7, 1) for i, axis in enumerate("xyz")),
        field("a b#\n", 0, 7, 1),
        field("a_b__", 4, 7, 1),
        field("", 8, 7, 0),
    ]
    cloud = decoded(ros_cloud(made, TIME_NS, "velo", fields=fields))
    assert list(cloud.extra) == ["a_b__", "a_b___", "_"]


@pytest.mark.parametrize("points", [0, 1])
def test_few_points(points: int) -> None:
    cloud = decoded(ros_cloud(records(points, [*XYZ, ("ring", "<u2")]), TIME_NS, "velo"))
    assert len(cloud) == points
    assert cloud.extra["ring"].dtype == np.uint16


def _grown(message: Any) -> None:
    message.width = message.height = 2**31


LIES: dict[str, Callable[[Any], None]] = {
    "more points than bytes": lambda m: setattr(m, "width", 10_000),
    "2^62 points": _grown,
    "rows shorter than points": lambda m: setattr(m, "row_step", 3),
    "a field out of the record": lambda m: setattr(m.fields[0], "offset", 10),
    "a count out of the record": lambda m: setattr(m.fields[2], "count", 2**31),
    "an unknown type": lambda m: setattr(m.fields[0], "datatype", 9),
    "no x": lambda m: setattr(m.fields[0], "name", "a"),
    "no fields": lambda m: setattr(m, "fields", []),
    "no stride": lambda m: setattr(m, "point_step", 0),
}


@pytest.mark.parametrize("lie", LIES)
def test_layouts_that_lie_are_typed_errors_that_name_the_topic(lie: str) -> None:
    message = ros_cloud(records(10, XYZ), TIME_NS, "velo")
    LIES[lie](message)
    with pytest.raises(PseudolidarError, match="/points"):
        decoded(message)


def test_more_points_than_believed() -> None:
    with pytest.raises(LimitError, match="11 points"):
        decoded(ros_cloud(records(11, XYZ), TIME_NS, "velo"), Limits(points=10))


def test_a_message_cut_anywhere() -> None:
    message = ros_cloud(records(10, [*XYZ, ("ring", "<u2")]), TIME_NS, "velo")
    data = bytes(ROS.serialize_cdr(message, message.__msgtype__))
    whole = decoded(message)
    for cut in range(len(data) - 1):
        with pytest.raises(PseudolidarError, match="/points"):
            Decoder(CHANNEL)(data[:cut])
    assert len(whole) == 10
