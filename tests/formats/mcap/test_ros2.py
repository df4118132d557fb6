"""Recordings of the ROS 2 profile, read by other people's libraries, every topic and value."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pseudolidar.errors import RecordingError, StructureError
from pseudolidar.formats.mcap.check import check_mcap
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.mcap.frame import FramePart, pack_frame
from pseudolidar.formats.mcap.log import McapLog, frames_in, part_path
from pseudolidar.formats.mcap.messages import frame_messages
from pseudolidar.formats.mcap.prolog import describe_recording
from pseudolidar.formats.ros.cdr import definition_text, encode_ros2, fields_of, schema_name
from pseudolidar.formats.ros.ros2_bag import write_bag_metadata
from pseudolidar.formats.ros.ros2_definitions import DEFINITIONS
from pseudolidar.geometry.frames import frame_tree
from pseudolidar.structures.disparity import DisparityMap
from tests.formats.mcap.test_messages import (
    BASELINE_M,
    HEIGHT,
    TIME_NS,
    WIDTH,
    K,
    bare_frame,
    full_cloud,
    full_frame,
    maps,
    turned_by,
)
from tests.rerun_program import Rerun

ROS2 = McapContent(profile="ros2", pixels=True)
PERIOD_NS = 100_000_000
EVERYTHING = {
    "/camera/left/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/left/image/compressed": "sensor_msgs/msg/CompressedImage",
    "/camera/right/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/right/image/compressed": "sensor_msgs/msg/CompressedImage",
    "/frame": "rcl_interfaces/msg/Log",
    "/labels": "visualization_msgs/msg/MarkerArray",
    "/labels/boxes": "vision_msgs/msg/Detection3DArray",
    "/log": "rcl_interfaces/msg/Log",
    "/odometry": "nav_msgs/msg/Odometry",
    "/pose": "geometry_msgs/msg/PoseStamped",
    "/stereo/depth": "sensor_msgs/msg/Image",
    "/stereo/disparity": "stereo_msgs/msg/DisparityImage",
    "/stereo/points": "sensor_msgs/msg/PointCloud2",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/velodyne/points": "sensor_msgs/msg/PointCloud2",
}
# Numpy type of sensor_msgs/PointField.datatype, written down from its definition.
NUMPY_TYPES = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
PROLOG = describe_recording(
    version="0", settings="", calibration="{}", matcher="", source="a", content=ROS2
)


def part(index: int) -> FramePart:
    disparity, depth = maps()
    frame = full_frame()
    assert frame.scan is not None
    shift_ns = index * PERIOD_NS
    frame = replace(
        frame,
        id=f"{index:06d}",
        index=index,
        timestamp_ns=TIME_NS + shift_ns,
        scan=replace(
            frame.scan,
            timestamp_ns=frame.scan.timestamp_ns + shift_ns,
            point_times_ns=frame.scan.point_times_ns + shift_ns,
        ),
    )
    cloud = replace(full_cloud(), timestamp_ns=frame.timestamp_ns)
    messages = frame_messages(frame, disparity=disparity, depth=depth, cloud=cloud, content=ROS2)
    return pack_frame(messages, index=index, compression="lz4")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of three frames and its metadata."""
    path = tmp_path_factory.mktemp("ros2") / "drive.mcap"
    with McapLog(path, PROLOG) as log:
        for index in range(3):
            log.append(part(index))
    write_bag_metadata(path.parent / "metadata.yaml", [path])
    return path.parent


@pytest.fixture(scope="module")
def messages(bag: Path) -> dict[str, Any]:
    """Messages of the first frame by topic, as `rosbags` reads them."""
    found: dict[str, Any] = {}
    with AnyReader([bag / "drive.mcap"]) as reader:
        assert {c.topic: c.msgtype for c in reader.connections} == EVERYTHING
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            assert (time_ns - TIME_NS) % PERIOD_NS == 0
            found.setdefault(connection.topic, message)
    return found


def columns_of(message: Any) -> np.ndarray[Any, Any]:
    layout = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [NUMPY_TYPES[field.datatype] for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    assert message.row_step == message.point_step * message.width == len(message.data)
    assert (message.height, message.is_bigendian, message.is_dense) == (1, False, True)
    return np.frombuffer(message.data, layout)


def nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


# --- definitions ----------------------------------------------------------------------------


def test_definitions_are_those_of_ros() -> None:
    """By the hash that ROS itself compares interfaces with (REP-2016)."""
    theirs, ours = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.EMPTY)
    for kind, text in DEFINITIONS.items():
        ours.register(get_types_from_msg(text, schema_name(kind)))
    known = [kind for kind in DEFINITIONS if schema_name(kind) in theirs.fielddefs]
    assert {kind for kind in DEFINITIONS if kind not in known} == {
        kind for kind in DEFINITIONS if kind.startswith("vision_msgs/")
    }
    for kind in known:
        name = schema_name(kind)
        assert ours.hash_rihs01(name) == theirs.hash_rihs01(name), kind


def example(kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Values of every field of a definition, arrays of some length."""
    result: dict[str, Any] = {}
    for field in fields_of(kind):
        count = field.count or int(rng.integers(0, 4))
        make = {
            "bool": lambda: bool(rng.integers(2)),
            "string": lambda: "ä" * int(rng.integers(0, 9)),
            "float32": lambda: float(np.float32(rng.normal())),
            "float64": lambda: float(rng.normal()),
            "uint8": lambda: int(rng.integers(256)),
        }.get(field.kind)
        if make is None and field.kind in DEFINITIONS:
            kind_below = field.kind
            make = lambda: example(kind_below, rng)  # noqa: B023, E731
        elif make is None:
            make = lambda: int(rng.integers(2**30))  # noqa: E731
        values = [make() for _ in range(count)]
        if field.kind == "uint8" and field.many:
            result[field.name] = bytes(values)
        else:
            result[field.name] = values if field.many else make()
    return result


@pytest.mark.parametrize("kind", DEFINITIONS)
def test_every_message_comes_back_from_rosbags(kind: str) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition_text(kind), schema_name(kind)))
    for seed in range(5):
        values = example(kind, np.random.default_rng(seed))
        data = b"".join(encode_ros2(kind, values))
        assert_same(store.deserialize_cdr(data, schema_name(kind)), values)


def assert_same(found: Any, expected: Any) -> None:
    if isinstance(expected, dict):
        for name, value in expected.items():
            assert_same(getattr(found, name), value)
    elif isinstance(expected, bytes):
        assert bytes(found) == expected
    elif isinstance(expected, list):
        assert len(found) == len(expected)
        for a, b in zip(found, expected, strict=True):
            assert_same(a, b)
    else:
        assert found == expected


@pytest.mark.parametrize(
    "values", [{"frame": "a"}, {"k": [1.0] * 8}, {"p": [0.0] * 9}], ids=["unknown", "short", "p"]
)
def test_values_that_do_not_fit_are_refused(values: dict[str, Any]) -> None:
    with pytest.raises(StructureError):
        encode_ros2("sensor_msgs/CameraInfo", values)


# --- every topic ----------------------------------------------------------------------------


def test_header_and_schemas(bag: Path) -> None:
    with (bag / "drive.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        decoded = list(reader.iter_decoded_messages())
        summary = reader.get_summary()
    assert summary is not None
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert len(decoded) == 3 * len(EVERYTHING)
    qos = {c.topic: c.metadata["offered_qos_profiles"] for c in summary.channels.values()}
    # rmw: durability 1 is transient local, 2 volatile.
    assert "durability: 1" in qos.pop("/tf_static")
    assert all("durability: 2" in text for text in qos.values())


def test_cloud(messages: dict[str, Any]) -> None:
    cloud, message = full_cloud(), messages["/stereo/points"]
    points = columns_of(message)
    assert (message.header.frame_id, nanoseconds(message.header.stamp)) == ("velodyne", TIME_NS)
    assert cloud.rgb is not None
    assert cloud.uv is not None
    expected = {
        **dict(zip("xyz", cloud.xyz.T, strict=True)),
        "rgb": None,
        "intensity": cloud.intensity,
        "sigma_m": cloud.sigma_m,
        **dict(zip("uv", cloud.uv.T, strict=True)),
        **cloud.extra,
    }
    assert list(points.dtype.names or ()) == list(expected)
    for name in expected.keys() - {"rgb"}:
        np.testing.assert_array_equal(points[name], expected[name], err_msg=name)
    assert points.dtype["rgb"].str == "<f4"
    bits = points["rgb"].view("<u4").astype(np.int64)
    unpacked = np.stack([bits >> 16, bits >> 8 & 255, bits & 255], axis=1)
    np.testing.assert_array_equal(unpacked, cloud.rgb)


def test_scan(messages: dict[str, Any]) -> None:
    scan, message = full_frame().scan, messages["/velodyne/points"]
    assert scan is not None
    points = columns_of(message)
    assert nanoseconds(message.header.stamp) == scan.timestamp_ns
    assert list(points.dtype.names or ()) == ["x", "y", "z", "intensity", "time"]
    np.testing.assert_array_equal(np.stack([points[c] for c in "xyz"], axis=1), scan.xyz)
    np.testing.assert_array_equal(points["intensity"], scan.reflectance)
    # float32 seconds of at most 0.1 s resolve 4 ns.
    np.testing.assert_allclose(points["time"], np.arange(70) * 1e-4, atol=4e-9)


def test_cameras_stand_in_the_left_frame(messages: dict[str, Any]) -> None:
    left, right = messages["/camera/left/camera_info"], messages["/camera/right/camera_info"]
    for camera in (left, right):
        assert camera.header.frame_id == "camera_left"
        assert (camera.width, camera.height) == (WIDTH, HEIGHT)
        np.testing.assert_array_equal(camera.k.reshape(3, 3), K)
        np.testing.assert_array_equal(camera.r.reshape(3, 3), np.eye(3))
        assert not camera.d.any()
    np.testing.assert_array_equal(left.p.reshape(3, 4), np.hstack([K, np.zeros((3, 1))]))
    assert right.p[3] == -K[0, 0] * BASELINE_M


def test_pictures(messages: dict[str, Any]) -> None:
    frame = full_frame()
    for side, image in (("left", frame.left), ("right", frame.right)):
        message = messages[f"/camera/{side}/image/compressed"]
        assert message.format == "rgb8; jpeg compressed bgr8"
        pixels = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_COLOR_RGB)
        # A JPEG of quality 90 of a smooth image; exchanged colours would be off by 50.
        assert np.abs(pixels.astype(float) - image).mean() < 6


def test_disparity_turns_into_depth(messages: dict[str, Any]) -> None:
    disparity, depth = maps()
    message = messages["/stereo/disparity"]
    stored = np.frombuffer(message.image.data, "<f4").reshape(HEIGHT, WIDTH)
    np.testing.assert_array_equal(stored, disparity.values)
    np.testing.assert_allclose(message.f * message.t / stored, depth.values, rtol=1e-6)
    assert message.image.encoding == "32FC1"
    assert message.min_disparity == np.nanmin(stored)
    assert message.max_disparity == np.nanmax(stored)
    stored_mm = np.frombuffer(messages["/stereo/depth"].data, "<u2").reshape(HEIGHT, WIDTH)
    near = depth.values <= 65.535
    np.testing.assert_allclose(stored_mm[near] / 1000, depth.values[near], atol=0.0005 + 1e-6)


def test_disparity_of_eyes_with_other_centres(tmp_path: Path) -> None:
    frame = bare_frame()
    K_right = K.copy()
    K_right[0, 2] += 3.5
    rig = replace(frame.rig, right=replace(frame.rig.right, K=K_right))
    disparity = DisparityMap(np.full((HEIGHT, WIDTH), 6.5, np.float32), None)
    disparity = replace(disparity, sigma=np.full((HEIGHT, WIDTH), 0.25, np.float32))
    parts = frame_messages(replace(frame, rig=rig), disparity=disparity, content=ROS2)
    with McapLog(tmp_path / "a.mcap", PROLOG) as log:
        log.append(pack_frame(parts, index=0))
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        chosen = [c for c in reader.connections if c.topic == "/stereo/disparity"]
        ((connection, _, raw),) = reader.messages(chosen)
        message: Any = reader.deserialize(raw, connection.msgtype)
    d = np.frombuffer(message.image.data, "<f4")
    Z_m = rig.Q @ np.array([0.0, 0.0, 6.5, 1.0])
    np.testing.assert_allclose(message.f * message.t / d, Z_m[2] / Z_m[3], rtol=1e-6)
    assert message.delta_d == 0.25


def test_transforms(messages: dict[str, Any]) -> None:
    frame = full_frame()
    expected = {(pose.dst, pose.src): pose for pose in frame_tree(frame.rig, frame.pose)}
    moving, fixed = messages["/tf"].transforms, messages["/tf_static"].transforms
    assert {t.header.frame_id for t in moving} == {"map", "odom"}
    found = [*moving, *fixed]
    assert {(t.header.frame_id, t.child_frame_id) for t in found} == set(expected)
    for t in found:
        pose = expected[t.header.frame_id, t.child_frame_id]
        move = t.transform.translation
        np.testing.assert_allclose((move.x, move.y, move.z), pose.translation_m)
        turned = turned_by(t.transform.rotation, np.array([1.0, 2.0, 3.0]))
        np.testing.assert_allclose(turned, pose.matrix[:3, :3] @ [1.0, 2.0, 3.0], atol=1e-12)
        assert nanoseconds(t.header.stamp) == TIME_NS


def test_pose(messages: dict[str, Any]) -> None:
    odometry, stamped = messages["/odometry"], messages["/pose"]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", "base_link")
    for pose in (odometry.pose.pose, stamped.pose):
        assert (pose.position.x, pose.position.y, pose.position.z) == (5.0, -2.0, 0.25)
        assert pose.orientation.w == 1.0


def test_boxes(messages: dict[str, Any]) -> None:
    (detection,) = messages["/labels/boxes"].detections
    (result,) = detection.results
    assert (result.hypothesis.class_id, detection.header.frame_id) == ("Car", "camera_left")
    size, centre = detection.bbox.size, detection.bbox.center.position
    assert (size.x, size.y, size.z) == (4.0, 1.7, 1.5)
    assert (centre.x, centre.y, centre.z) == (1.0, 0.5, 18.0)
    deletion, cube, text = messages["/labels"].markers
    assert (deletion.action, cube.type, text.type) == (3, 1, 9)
    assert (cube.scale.x, cube.pose.position.z, text.text) == (4.0, 18.0, "Car")
    forward = turned_by(cube.pose.orientation, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(forward, [0.0, 0.0, 1.0], atol=1e-12)


def test_log_and_mark(messages: dict[str, Any]) -> None:
    assert (messages["/frame"].name, messages["/frame"].level) == ("000000", 20)
    assert messages["/log"].msg == "alpha channel dropped"


# --- as a bag -------------------------------------------------------------------------------


def test_the_folder_is_a_bag(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        assert reader.message_count == 3 * len(EVERYTHING)
        assert reader.duration >= 2 * PERIOD_NS
        assert {c.topic: c.msgtype for c in reader.connections} == EVERYTHING
        latched = {
            c.topic
            for c in reader.connections
            if c.ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        }
        assert latched == {"/tf_static"}
        assert sum(1 for _ in reader.messages()) == reader.message_count


def test_killed_and_continued_it_is_the_same(bag: Path, tmp_path: Path) -> None:
    whole = (bag / "drive.mcap").read_bytes()
    parts = [part(index) for index in range(3)]
    names = [p.frame_id for p in parts]
    path = tmp_path / "a.mcap"
    for cut in (0, 3000, len(whole) // 2, len(whole) - 5, len(whole)):
        path.unlink(missing_ok=True)
        part_path(path).write_bytes(whole[:cut])
        with McapLog(path, PROLOG, committed=names) as log:
            assert len(log.held) == len(frames_in(part_path(path)))
            for p in parts[len(log.held) :]:
                log.append(p)
        assert path.read_bytes() == whole


def test_our_check(bag: Path, tmp_path: Path) -> None:
    summary = check_mcap(bag / "drive.mcap")
    assert summary.messages == dict.fromkeys(sorted(EVERYTHING), 3)
    assert (summary.frames, summary.skipped) == (3, ())


def test_our_check_finds_what_is_wrong(tmp_path: Path) -> None:
    disparity, _ = maps()
    lost = replace(full_cloud(), frame="camera_left")
    messages = list(frame_messages(full_frame(), cloud=lost, disparity=disparity, content=ROS2))
    # Without transforms between sensors the frame of the points hangs nowhere.
    messages = [m for m in messages if m.profile.topic(m.channel).name != "/tf_static"]
    with (
        pytest.raises(RecordingError, match="that no transform names"),
        McapLog(tmp_path / "a.mcap", PROLOG) as log,
    ):
        log.append(pack_frame(messages, index=0))


def test_rerun_finds_no_fault(bag: Path, rerun: Rerun) -> None:
    report = rerun("mcap", "check", "--full", bag / "drive.mcap").splitlines()
    rows = [line.split() for line in report if " /" in line]
    status = {topic: state for state, _, _, topic, *_ in rows}
    assert set(status) == set(EVERYTHING)
    assert set(status.values()) == {"ok"}


# --- kiss-icp -------------------------------------------------------------------------------

ODOMETRY = """
import json, sys
import numpy as np
from kiss_icp.config import load_config
from kiss_icp.datasets.mcap import McapDataloader
from kiss_icp.kiss_icp import KissICP

CONSTANTS = {"INT8": 1, "UINT8": 2, "INT16": 3, "UINT16": 4, "INT32": 5, "UINT32": 6,
             "FLOAT32": 7, "FLOAT64": 8}

def with_constants(messages):
    # kiss-icp 1.3 looks for the constants of PointField on each field, as messages of ROS have
    # them; mcap-ros2-support (0.5.0 to 0.6.0) leaves constants out of what it decodes, whoever
    # wrote the file.
    for message in messages:
        for field in message.ros_msg.fields:
            vars(field).update(CONSTANTS)
        yield message

loader = McapDataloader(sys.argv[1], sys.argv[2])
loader.msgs = with_constants(loader.msgs)
odometry, steps, points = KissICP(load_config(None)), [], []
for index in range(len(loader)):
    frame, times = loader[index]
    before = odometry.last_pose.copy()
    odometry.register_frame(frame, times)
    steps.append(float(np.linalg.norm((np.linalg.inv(before) @ odometry.last_pose)[:3, 3])))
    points.append(len(frame))
print(json.dumps({"steps": steps, "points": points, "times": loader.get_frames_timestamps()}))
"""


@pytest.fixture(scope="module")
def kitti(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("kitti")
    drive = real_data / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0002_sync"
    command = ["convert", str(drive), str(out), "--to", "mcap", "--mcap-profile", "ros2"]
    program = [sys.executable, "-m", "pseudolidar.cli"]
    subprocess.run([*program, *command], check=True, capture_output=True)
    return out


def run_odometry(recording: Path, topic: str) -> dict[str, list[float]]:
    command = [sys.executable, "-c", ODOMETRY, str(recording), topic]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, list[float]] = json.loads(done.stdout.splitlines()[-1])
    return result


@pytest.mark.real
def test_kiss_icp_reads_the_scans_and_finds_the_way(kitti: Path) -> None:
    (recording,) = kitti.glob("*.mcap")
    found = run_odometry(recording, "/velodyne/points")
    assert len(found["steps"]) == 10
    assert min(found["points"]) > 100_000
    # By OXTS the car went 0.87 to 0.98 m a frame.
    assert 0.85 < min(found["steps"][1:]) <= max(found["steps"][1:]) < 1.0


@pytest.mark.real
def test_kiss_icp_reads_and_runs_on_the_stereo_clouds(kitti: Path) -> None:
    (recording,) = kitti.glob("*.mcap")
    found = run_odometry(recording, "/stereo/points")
    assert found["points"] == [250_000] * 10
    assert np.isfinite(found["steps"]).all()


@pytest.mark.real
def test_kiss_icp_reads_the_folder_as_a_bag_unchanged(kitti: Path) -> None:
    from kiss_icp.datasets.rosbag import RosbagDataset

    bag = RosbagDataset(kitti, "/velodyne/points")
    points, times = bag[0]
    assert points.shape[0] > 100_000
    assert points.shape[1] == 3
    assert len(times) == 0
