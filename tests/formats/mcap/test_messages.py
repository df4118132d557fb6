from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from pseudolidar.errors import SequenceTime, StructureError, UsageError
from pseudolidar.formats.mcap.check import check_mcap
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.mcap.frame import pack_frame
from pseudolidar.formats.mcap.log import McapLog
from pseudolidar.formats.mcap.messages import frame_messages
from pseudolidar.formats.mcap.prolog import describe_recording
from pseudolidar.geometry.frames import R_BODY_OPTICAL, frame_tree
from pseudolidar.structures.box import Box3D, Detection, Label
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose
from tests.rerun_program import Rerun

TIME_NS = 1_317_013_333_123_456_789
WIDTH, HEIGHT = 32, 16
K = np.array([[50.0, 0.0, 15.5], [0.0, 50.0, 7.5], [0.0, 0.0, 1.0]])
BASELINE_M = 0.5
# Numpy type of Foxglove's PackedElementField.NumericType, written down from its documentation.
NUMPY_TYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<f4", 8: "<f8"}
EVERYTHING = {
    "/camera/left/calibration",
    "/camera/left/image",
    "/camera/right/calibration",
    "/camera/right/image",
    "/frame",
    "/labels",
    "/log",
    "/pose",
    "/stereo/depth",
    "/stereo/disparity",
    "/stereo/points",
    "/tf",
    "/velodyne/points",
}


def rig() -> StereoRig:
    T_right_left = Pose.from_rotation(
        "camera_right", "camera_left", np.eye(3), np.array([-BASELINE_M, 0.0, 0.0])
    )
    left, right = Camera(K, WIDTH, HEIGHT), Camera(K, WIDTH, HEIGHT, frame="camera_right")
    return StereoRig(left, right, T_right_left)


def rig_with_lidar() -> StereoRig:
    T_left_velodyne = Pose.from_rotation(
        "camera_left", "velodyne", R_BODY_OPTICAL.T, np.array([0.0, -0.1, -0.3])
    )
    T_velodyne_imu = Pose.from_rotation("velodyne", "imu", np.eye(3), np.array([-0.8, 0.3, -0.9]))
    return replace(rig(), T_left_velodyne=T_left_velodyne, T_velodyne_imu=T_velodyne_imu)


def bare_frame() -> StereoFrame:
    rng = np.random.default_rng(1)
    image = cv2.resize(rng.integers(0, 255, (4, 8, 3), dtype=np.uint8), (WIDTH, HEIGHT))
    return StereoFrame(image, image[:, ::-1].copy(), rig(), "000042", 42, TIME_NS)


def full_frame() -> StereoFrame:
    rng = np.random.default_rng(2)
    scan = LidarScan(
        rng.normal(size=(70, 3)).astype(np.float32),
        rng.random(70, np.float32),
        timestamp_ns=TIME_NS - 5_000_000,
        point_times_ns=TIME_NS - 5_000_000 + np.arange(70, dtype=np.int64) * 100_000,
    )
    T_left_box = Pose.from_rotation(
        "camera_left", "box", R_BODY_OPTICAL.T, np.array([1.0, 0.5, 18.0])
    )
    car = Label(Detection("Car", (1.0, 2.0, 9.0, 8.0)), Box3D(T_left_box, 4.0, 1.7, 1.5))
    region = Label(Detection("DontCare", (1.0, 2.0, 9.0, 8.0)), None, ignore=True)
    pose = Pose.from_rotation("map", "base_link", np.eye(3), np.array([5.0, -2.0, 0.25]))
    return replace(
        bare_frame(),
        rig=rig_with_lidar(),
        scan=scan,
        labels=(car, region),
        pose=pose,
        notes=("alpha channel dropped",),
    )


def full_cloud(n: int = 20_000) -> PointCloud:
    """More points than one block of the writer, with every column."""
    rng = np.random.default_rng(3)
    return PointCloud(
        rng.normal(size=(n, 3)).astype(np.float32),
        "velodyne",
        TIME_NS,
        rgb=rng.integers(0, 255, (n, 3), dtype=np.uint8),
        intensity=rng.random(n, np.float32),
        sigma_m=rng.random(n, np.float32),
        uv=rng.random((n, 2), np.float32) * 1000,
        extra={
            "ring": rng.integers(0, 64, n).astype(np.uint16),
            "height_m": rng.normal(size=n),
            "ground": rng.random(n) > 0.5,
            "track": rng.integers(-5, 2**40, n),
        },
    )


def maps() -> tuple[DisparityMap, DepthMap]:
    rng = np.random.default_rng(4)
    d = (rng.random((HEIGHT, WIDTH)) * 30 + 0.1).astype(np.float32)
    d[3:5] = np.nan
    return DisparityMap(d), DepthMap(np.float32(K[0, 0] * BASELINE_M) / d)


def written(path: Path, frame: StereoFrame, **results: Any) -> dict[str, Any]:
    """Decoded messages by topic, read by `mcap` with the schemas of the file alone."""
    prolog = describe_recording(version="0", settings="", calibration="", matcher="", source="")
    with McapLog(path, prolog) as log:
        log.append(pack_frame(frame_messages(frame, **results), index=frame.index))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        messages = list(reader.iter_decoded_messages())
    assert {m.log_time for _, _, m, _ in messages} == {frame.timestamp_ns}
    assert {m.publish_time for _, _, m, _ in messages} == {frame.timestamp_ns}
    assert all(schema.name.startswith("foxglove.") for schema, _, _, _ in messages)
    return {channel.topic: content for _, channel, _, content in messages}


def points_of(message: Any) -> np.ndarray[Any, Any]:
    layout = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [NUMPY_TYPES[field.type] for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_stride,
        }
    )
    return np.frombuffer(message.data, layout)


def nanoseconds(stamp: Any) -> int:
    return int(stamp.ToNanoseconds())


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    disparity, depth = maps()
    return written(
        tmp_path_factory.mktemp("mcap") / "a.mcap",
        full_frame(),
        disparity=disparity,
        depth=depth,
        cloud=full_cloud(),
        notes=("3 points dropped",),
        content=McapContent(pixels=True),
    )


# --- everything there is --------------------------------------------------------------------


def test_a_full_frame_has_all_topics(messages: dict[str, Any]) -> None:
    assert set(messages) == EVERYTHING


def test_every_column_of_the_cloud(messages: dict[str, Any]) -> None:
    cloud, message = full_cloud(), messages["/stereo/points"]
    points = points_of(message)
    assert message.frame_id == "velodyne"
    assert nanoseconds(message.timestamp) == TIME_NS
    assert (message.pose.orientation.w, message.pose.orientation.x) == (1.0, 0.0)
    assert len(points) == len(cloud)
    expected = {
        **dict(zip("xyz", cloud.xyz.T, strict=True)),
        **dict(zip(("red", "green", "blue"), cloud.rgb.T, strict=True)),
        "alpha": np.full(len(cloud), 255),
        "intensity": cloud.intensity,
        "sigma_m": cloud.sigma_m,
        **dict(zip("uv", cloud.uv.T, strict=True)),
        **cloud.extra,
    }
    assert list(points.dtype.names or ()) == list(expected)
    for name, column in expected.items():
        np.testing.assert_array_equal(points[name], column, err_msg=name)
    colours = [field.offset for field in message.fields if field.name in ("red", "alpha")]
    assert colours == [12, 15]
    assert [points.dtype[name].str for name in ("ring", "height_m", "red")] == ["<u2", "<f8", "|u1"]


def test_scan(messages: dict[str, Any]) -> None:
    scan, message = full_frame().scan, messages["/velodyne/points"]
    assert scan is not None
    points = points_of(message)
    assert message.frame_id == "velodyne"
    assert nanoseconds(message.timestamp) == scan.timestamp_ns
    np.testing.assert_array_equal(np.stack([points[c] for c in "xyz"], axis=1), scan.xyz)
    np.testing.assert_array_equal(points["intensity"], scan.reflectance)
    # float32 seconds of at most 0.1 s resolve 4 ns.
    np.testing.assert_allclose(points["t_s"], np.arange(70) * 1e-4, atol=4e-9)


def test_disparity_and_depth(messages: dict[str, Any]) -> None:
    disparity, depth = maps()
    message = messages["/stereo/disparity"]
    assert (message.encoding, message.step, message.frame_id) == ("32FC1", 4 * WIDTH, "camera_left")
    stored = np.frombuffer(message.data, "<f4").reshape(HEIGHT, WIDTH)
    np.testing.assert_array_equal(stored, disparity.values)
    message = messages["/stereo/depth"]
    assert (message.encoding, message.width, message.height) == ("16UC1", WIDTH, HEIGHT)
    stored_mm = np.frombuffer(message.data, "<u2").reshape(HEIGHT, WIDTH)
    near = depth.values <= 65.535
    assert 0 < near.sum() < depth.valid.sum()
    assert not stored_mm[~near].any()
    np.testing.assert_allclose(stored_mm[near] / 1000, depth.values[near], atol=0.0005 + 1e-6)


def test_images(messages: dict[str, Any]) -> None:
    frame = full_frame()
    for side, image in (("left", frame.left), ("right", frame.right)):
        message = messages[f"/camera/{side}/image"]
        assert (message.format, message.frame_id) == ("jpeg", f"camera_{side}")
        pixels = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR_RGB)
        # A JPEG of quality 90 of a smooth image; exchanged colours would be off by 50.
        assert np.abs(pixels.astype(float) - image).mean() < 6


def test_calibrations(messages: dict[str, Any]) -> None:
    left, right = messages["/camera/left/calibration"], messages["/camera/right/calibration"]
    assert (left.frame_id, right.frame_id) == ("camera_left", "camera_right")
    assert (left.width, left.height) == (WIDTH, HEIGHT)
    assert list(left.K) == list(right.K) == K.ravel().tolist()
    assert list(left.R) == np.eye(3).ravel().tolist()
    assert not left.D
    np.testing.assert_array_equal(np.reshape(left.P, (3, 4)), np.hstack([K, np.zeros((3, 1))]))
    assert right.P[3] == -K[0, 0] * BASELINE_M


def test_transforms(messages: dict[str, Any]) -> None:
    frame = full_frame()
    expected = {(pose.dst, pose.src): pose for pose in frame_tree(frame.rig, frame.pose)}
    found = messages["/tf"].transforms
    assert {(t.parent_frame_id, t.child_frame_id) for t in found} == set(expected)
    for transform in found:
        pose = expected[transform.parent_frame_id, transform.child_frame_id]
        t, q = transform.translation, transform.rotation
        np.testing.assert_allclose((t.x, t.y, t.z), pose.translation_m)
        turned = turned_by(q, np.array([1.0, 2.0, 3.0]))
        np.testing.assert_allclose(turned, pose.matrix[:3, :3] @ [1.0, 2.0, 3.0], atol=1e-12)
        assert nanoseconds(transform.timestamp) == TIME_NS


def turned_by(q: Any, v: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    axis = np.array([q.x, q.y, q.z])
    return np.asarray(v + 2 * np.cross(axis, np.cross(axis, v) + q.w * v))


def test_labels(messages: dict[str, Any]) -> None:
    (entity,) = messages["/labels"].entities
    (cube,) = entity.cubes
    assert entity.frame_id == "camera_left"
    assert (cube.size.x, cube.size.y, cube.size.z) == (4.0, 1.7, 1.5)
    assert (cube.pose.position.x, cube.pose.position.z) == (1.0, 18.0)
    forward = turned_by(cube.pose.orientation, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(forward, [0.0, 0.0, 1.0], atol=1e-12)
    assert entity.texts[0].text == "Car"
    assert len(messages["/labels"].deletions) == 1


def test_log_and_mark(messages: dict[str, Any]) -> None:
    assert messages["/frame"].name == "000042"
    assert messages["/frame"].message == "frame 000042, index 42"
    assert messages["/log"].message == "3 points dropped"


# --- less than everything -------------------------------------------------------------------


def test_a_bare_frame(tmp_path: Path) -> None:
    messages = written(tmp_path / "a.mcap", bare_frame())
    assert set(messages) == {
        *("/frame", "/tf", "/camera/left/image", "/camera/left/calibration"),
        *("/camera/right/image", "/camera/right/calibration"),
    }
    assert "no pose: map, odom and base_link coincide" in messages["/frame"].message


def test_a_cloud_of_coordinates_alone(tmp_path: Path) -> None:
    cloud = PointCloud(np.ones((3, 3)), "camera_left")
    message = written(tmp_path / "a.mcap", bare_frame(), cloud=cloud)["/stereo/points"]
    assert [field.name for field in message.fields] == ["x", "y", "z"]
    assert message.point_stride == 24
    assert nanoseconds(message.timestamp) == TIME_NS


def test_an_empty_cloud(tmp_path: Path) -> None:
    cloud = full_cloud()[:0]
    frame = replace(bare_frame(), rig=rig_with_lidar())
    message = written(tmp_path / "a.mcap", frame, cloud=cloud)["/stereo/points"]
    assert message.data == b""
    assert len(message.fields) == 13


def test_points_without_coordinates_are_left_out(tmp_path: Path) -> None:
    xyz = np.arange(18, dtype=np.float32).reshape(6, 3)
    xyz[[1, 4]] = np.nan
    cloud = PointCloud(xyz, "camera_left", intensity=np.arange(6, dtype=np.float32), shape=(2, 3))
    points = points_of(written(tmp_path / "a.mcap", bare_frame(), cloud=cloud)["/stereo/points"])
    assert points["intensity"].tolist() == [0, 2, 3, 5]
    assert np.isfinite(points["x"]).all()


def test_a_scan_that_is_not_calibrated_is_left_out_and_said(tmp_path: Path) -> None:
    frame = replace(full_frame(), rig=rig(), notes=())
    messages = written(tmp_path / "a.mcap", frame)
    assert "/velodyne/points" not in messages
    assert "velodyne is not calibrated" in messages["/log"].message


def test_16_bit_images_keep_their_values(tmp_path: Path) -> None:
    image = (bare_frame().left.astype(np.uint16) * 257)[:, :, 0]
    frame = replace(bare_frame(), left=image, right=image)
    message = written(tmp_path / "a.mcap", frame)["/camera/left/image"]
    assert message.format == "png"
    pixels = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(pixels, image)


def test_what_is_not_wanted_is_left_out(tmp_path: Path) -> None:
    disparity, depth = maps()
    content = McapContent(images="none", disparity=False, depth="png", scan=False, labels=False)
    messages = written(
        tmp_path / "a.mcap",
        replace(full_frame(), notes=()),
        disparity=disparity,
        depth=depth,
        content=content,
    )
    calibrations = ("/camera/left/calibration", "/camera/right/calibration")
    assert set(messages) == {"/frame", "/tf", "/pose", "/stereo/depth/png", *calibrations}
    data = np.frombuffer(messages["/stereo/depth/png"].data, np.uint8)
    stored_mm = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    assert stored_mm.dtype == np.uint16
    near = depth.values <= 65.535
    np.testing.assert_allclose(stored_mm[near] / 1000, depth.values[near], atol=0.0005 + 1e-6)


@pytest.mark.parametrize(
    ("dtype", "stored"),
    [
        *(("bool", "|u1"), ("int8", "|i1"), ("uint8", "|u1"), ("int16", "<i2"), ("uint16", "<u2")),
        *(("int32", "<i4"), ("uint32", "<u4"), ("float32", "<f4"), ("float64", "<f8")),
        # Types that the schema has no number for are widened.
        *(("float16", "<f4"), ("int64", "<f8"), ("uint64", "<f8"), (">i4", "<i4"), (">f8", "<f8")),
    ],
)
def test_columns_of_every_type(tmp_path: Path, dtype: str, stored: str) -> None:
    kind = np.dtype(dtype)
    ends = (np.iinfo(kind).min, np.iinfo(kind).max) if kind.kind in "iu" else (0, 1.5)
    column = np.array(ends).astype(kind)
    cloud = PointCloud(np.ones((2, 3), np.float32), "camera_left", extra={"value": column})
    points = points_of(written(tmp_path / "a.mcap", bare_frame(), cloud=cloud)["/stereo/points"])
    assert points.dtype["value"].str == stored
    np.testing.assert_array_equal(points["value"], column.astype(stored))


# --- refused --------------------------------------------------------------------------------


def test_frames_without_a_time_are_refused() -> None:
    with pytest.raises(SequenceTime, match="positive"):
        frame_messages(replace(bare_frame(), timestamp_ns=0))


@pytest.mark.parametrize(
    ("extra", "text"),
    [
        ({"flow": np.zeros((5, 2))}, "flow"),
        ({"name": np.array(list("abcde"))}, "name"),
        ({"x": np.zeros(5)}, "other names"),
    ],
)
def test_columns_that_have_no_place_in_a_message(extra: dict[str, Any], text: str) -> None:
    cloud = PointCloud(np.ones((5, 3), np.float32), "camera_left", extra=extra)
    with pytest.raises(StructureError, match=text):
        frame_messages(bare_frame(), cloud=cloud)


def test_a_cloud_in_a_frame_that_the_rig_lacks_is_refused() -> None:
    with pytest.raises(StructureError, match="velodyne"):
        frame_messages(bare_frame(), cloud=full_cloud())


# --- other people's readers -----------------------------------------------------------------


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mcap") / "full.mcap"
    disparity, depth = maps()
    prolog = describe_recording(
        version="0", settings="{}", calibration="{}", matcher="census", source="synthetic:street"
    )
    with McapLog(path, prolog) as log:
        for index in range(3):
            shift_ns = index * 100_000_000
            frame = full_frame()
            assert frame.scan is not None
            scan = replace(frame.scan, timestamp_ns=frame.scan.timestamp_ns + shift_ns)
            frame = replace(frame, timestamp_ns=TIME_NS + shift_ns, index=index, scan=scan)
            cloud = replace(full_cloud(500), timestamp_ns=frame.timestamp_ns)
            messages = frame_messages(frame, disparity=disparity, depth=depth, cloud=cloud)
            log.append(pack_frame(messages, index=index))
    return path


def test_rerun_finds_no_fault(recording: Path, rerun: Rerun) -> None:
    report = rerun("mcap", "check", "--full", recording).splitlines()
    rows = [line.split() for line in report if " /" in line]
    assert {topic: (status, *issues) for status, _, _, topic, *issues in rows} == dict.fromkeys(
        EVERYTHING, ("ok", "—")
    )


def test_rerun_reads_messages_as_what_they_are(
    recording: Path, tmp_path: Path, rerun: Rerun
) -> None:
    converted = tmp_path / "full.rrd"
    rerun("mcap", "convert", recording, "-o", converted)
    parts = re.findall(r" - (/\S+) - data columns: \[(.*)\]", rerun("rrd", "print", converted))
    found = {(topic, part.split(":")[0]) for topic, parts in parts for part in parts.split()}
    assert found >= {
        ("/stereo/points", "Points3D"),
        ("/velodyne/points", "Points3D"),
        ("/stereo/disparity", "Image"),
        ("/stereo/depth", "Image"),
        ("/camera/left/image", "EncodedImage"),
        ("/camera/right/calibration", "Pinhole"),
        ("/tf", "Transform3D"),
        ("/frame", "TextLog"),
    }


def test_our_own_check_finds_no_fault(recording: Path) -> None:
    summary = check_mcap(recording)
    assert summary.messages == dict.fromkeys(sorted(EVERYTHING), 3)
    assert (summary.frames, summary.skipped) == (3, ())
    assert (summary.start_ns, summary.end_ns) == (TIME_NS, TIME_NS + 200_000_000)


@pytest.mark.parametrize("quality", [-1, 101])
def test_a_quality_that_jpeg_has_not_is_refused(quality: int) -> None:
    with pytest.raises(UsageError, match="0 to 100"):
        McapContent(jpeg_quality=quality)
