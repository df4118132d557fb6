"""Frames in several chunks, of other kinds, thinned, split in two files, packed by Draco."""

from __future__ import annotations

import random
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from pseudolidar.errors import MissingDependency, UsageError
from pseudolidar.formats.mcap.check import check_mcap
from pseudolidar.formats.mcap.columns import cloud_columns
from pseudolidar.formats.mcap.content import Compression, McapContent
from pseudolidar.formats.mcap.frame import CHUNK_BYTES, FramePart, pack_frame
from pseudolidar.formats.mcap.log import McapLog, frames_in, part_path
from pseudolidar.formats.mcap.messages import LogMessage, frame_messages
from pseudolidar.formats.mcap.prolog import describe_recording
from pseudolidar.formats.mcap.split import split_messages
from pseudolidar.formats.points.draco import ERROR_M, encode_draco
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import DepthFrame, RecordedCloud
from tests.formats.mcap.test_messages import TIME_NS, K, full_cloud, full_frame, maps, points_of

PERIOD_NS = 100_000_000
PLAIN = McapContent()


def prolog(content: McapContent = PLAIN) -> Any:
    return describe_recording(
        version="0", settings="", calibration="", matcher="", source="", content=content
    )


def topics_of(messages: Sequence[LogMessage]) -> list[str]:
    return [message.profile.topic(message.channel).name for message in messages]


def decoded(path: Path, messages: Sequence[LogMessage]) -> dict[str, Any]:
    """Messages by topic, from a recording of one frame that passed our check."""
    with McapLog(path, prolog()) as log:
        log.append(pack_frame(messages, index=0))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return {channel.topic: content for _, channel, _, content in reader.iter_decoded_messages()}


# --- chunks ---------------------------------------------------------------------------------


def big_frame(index: int, compression: Compression = "none") -> FramePart:
    """Clouds of 5 and 2.4 MB, a disparity and a depth of 1.2 MB and 0.6 MB, small messages."""
    rng = np.random.default_rng(index)
    frame = replace(full_frame(), id=f"{index:06d}", index=index, labels=None)
    frame = replace(frame, timestamp_ns=TIME_NS + index * PERIOD_NS)
    scan = LidarScan(rng.normal(size=(200_000, 3)).astype(np.float32), None, frame.timestamp_ns)
    cloud = PointCloud(rng.normal(size=(420_000, 3)).astype(np.float32), "velodyne")
    d = rng.random((500, 600)).astype(np.float32) + 1
    messages = frame_messages(
        replace(frame, scan=scan),
        disparity=DisparityMap(d),
        depth=DepthMap(d),
        cloud=cloud,
        content=McapContent(max_points=0),
    )
    return pack_frame(messages, index=index, compression=compression)


def test_chunks_are_small_and_the_mark_is_in_the_last() -> None:
    part = big_frame(3)
    sizes = [chunk.unpacked_bytes for chunk in part.chunks]
    assert [size > CHUNK_BYTES for size in sizes].count(True) == 1
    # What is larger than 4 MB stands alone.
    assert next(c for c in part.chunks if c.unpacked_bytes > CHUNK_BYTES).counts.keys() == {11}
    assert [chunk.marks for chunk in part.chunks] == [*[None] * (len(sizes) - 1), "000003"]
    assert len(sizes) == 4


def test_small_messages_fill_chunks_up_to_the_cap() -> None:
    messages = list(frame_messages(full_frame()))
    lines = [replace(messages[1], parts=(b"x" * 900_000,)) for _ in range(11)]
    part = pack_frame([*lines, *messages], index=0, compression="none")
    sizes = [chunk.unpacked_bytes for chunk in part.chunks]
    assert len(sizes) == 3
    assert all(3_500_000 < size <= CHUNK_BYTES for size in sizes[:2])


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_cut_anywhere_frames_are_whole_or_absent(tmp_path: Path, compression: Compression) -> None:
    parts = [big_frame(index, compression) for index in range(2)]
    names = [part.frame_id for part in parts]
    path = tmp_path / "whole.mcap"
    with McapLog(path, prolog()) as log:
        for part in parts:
            log.append(part)
    whole = path.read_bytes()
    begin = whole.index(parts[0].chunks[0].head)
    ends = [begin]
    for part in parts:
        ends.append(ends[-1] + part.nbytes)
    rng = random.Random(1)
    between = [begin + sum(c.nbytes for c in parts[0].chunks[:n]) for n in (1, 2, 3)]
    for cut in (*between, *ends, *(rng.randrange(len(whole)) for _ in range(4))):
        path = tmp_path / "cut.mcap"
        path.unlink(missing_ok=True)
        part_path(path).write_bytes(whole[:cut])
        assert frames_in(part_path(path)) == tuple(names[: sum(end <= cut for end in ends[1:])])
        with McapLog(path, prolog(), committed=names) as log:
            for part in parts[len(log.held) :]:
                log.append(part)
        assert path.read_bytes() == whole, f"cut at byte {cut}"


def test_each_chunk_can_be_read_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with McapLog(path, prolog()) as log:
        for index in range(2):
            log.append(big_frame(index))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert len(summary.chunk_indexes) == 8
        only = list(reader.iter_messages(topics=["/velodyne/points"]))
    assert [message.sequence for _, _, message in only] == [0, 1]
    assert check_mcap(path, every=2).messages == check_mcap(path).messages


# --- points of a message --------------------------------------------------------------------


def test_points_of_a_message_are_bounded_and_that_is_told(tmp_path: Path) -> None:
    cloud = full_cloud(5000)
    content = McapContent(max_points=1200)
    messages = frame_messages(replace(full_frame(), notes=()), cloud=cloud, content=content)
    found = decoded(tmp_path / "a.mcap", messages)
    points = points_of(found["/stereo/points"])
    assert len(points) == 1200
    assert "1200 of 5000" in found["/log"].message
    # Whole points of the cloud, with their columns.
    rows = {x: i for i, x in enumerate(cloud.xyz[:, 0].tolist())}
    chosen = [rows[x] for x in points["x"].tolist()]
    np.testing.assert_array_equal(points["ring"], cloud.extra["ring"][chosen])
    assert "1200" in prolog(content).metadata["points_per_message"]


def test_unbounded(tmp_path: Path) -> None:
    messages = frame_messages(full_frame(), cloud=full_cloud(), content=McapContent(max_points=0))
    assert len(points_of(decoded(tmp_path / "a.mcap", messages)["/stereo/points"])) == 20_000


def test_a_negative_bound_is_refused() -> None:
    with pytest.raises(UsageError, match="at most -1"):
        McapContent(max_points=-1)


# --- split ----------------------------------------------------------------------------------


def test_pictures_and_clouds_apart_are_each_complete(tmp_path: Path) -> None:
    disparity, depth = maps()
    messages = frame_messages(full_frame(), disparity=disparity, depth=depth, cloud=full_cloud())
    split = split_messages(messages, "images,clouds")
    assert {name: set(topics_of(part)) for name, part in split.items()} == {
        "images": {
            *("/frame", "/log", "/tf", "/pose", "/stereo/disparity", "/stereo/depth"),
            *("/camera/left/image", "/camera/left/calibration"),
            *("/camera/right/image", "/camera/right/calibration"),
        },
        "clouds": {
            *("/frame", "/log", "/tf", "/pose", "/stereo/points", "/velodyne/points", "/labels")
        },
    }
    for name, part in split.items():
        decoded(tmp_path / f"{name}.mcap", part)
        assert check_mcap(tmp_path / f"{name}.mcap").frames == 1
    assert split_messages(messages, "none") == {"": messages}


# --- other kinds of frames ------------------------------------------------------------------


def pose(dst: str, src: str, x_m: float) -> Pose:
    return Pose.from_rotation(dst, src, np.eye(3), np.array([x_m, 0.0, 0.0]))


def recorded(**changes: Any) -> RecordedCloud:
    cloud = replace(full_cloud(300), sigma_m=None)
    tree = (pose("odom", "base", 1.0), pose("base", "velodyne", 0.5))
    return RecordedCloud(
        **({"cloud": cloud, "id": "a", "index": 0, "timestamp_ns": TIME_NS, "tree": tree} | changes)
    )


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_a_recorded_cloud_has_its_columns_and_its_tree(tmp_path: Path, profile: Any) -> None:
    content = McapContent(profile=profile)
    messages = frame_messages(recorded(), content=content)
    assert topics_of(messages) == ["/frame", "/tf", "/points"]
    with McapLog(tmp_path / "a.mcap", prolog(content)) as log:
        log.append(pack_frame(messages, index=0))
    assert check_mcap(tmp_path / "a.mcap").messages == {"/frame": 1, "/points": 1, "/tf": 1}


def test_every_column_of_a_recorded_cloud(tmp_path: Path) -> None:
    frame = recorded()
    found = decoded(tmp_path / "a.mcap", frame_messages(frame))
    points = points_of(found["/points"])
    assert found["/points"].frame_id == "velodyne"
    for name, column in cloud_columns(frame.cloud, pixels=False).items():
        np.testing.assert_array_equal(points[name], column, err_msg=name)
    edges = [
        (t.parent_frame_id, t.child_frame_id, t.translation.x) for t in found["/tf"].transforms
    ]
    assert edges == [("odom", "base", 1.0), ("base", "velodyne", 0.5)]


def test_a_cloud_with_sigma_is_a_stereo_cloud() -> None:
    assert "/stereo/points" in topics_of(frame_messages(recorded(cloud=full_cloud(9))))


def test_transforms_that_do_not_reach_the_cloud_are_left_out_and_that_is_told(
    tmp_path: Path,
) -> None:
    tree = (*recorded().tree, pose("world", "drone", 3.0))
    found = decoded(tmp_path / "a.mcap", frame_messages(recorded(tree=tree)))
    assert len(found["/tf"].transforms) == 2
    assert "not tied to velodyne" in found["/log"].message
    alone = frame_messages(recorded(tree=(pose("world", "drone", 3.0),)))
    assert topics_of(alone) == ["/frame", "/log", "/points"]
    assert topics_of(frame_messages(recorded(tree=()))) == ["/frame", "/points"]


def test_scan_beside_a_recorded_cloud() -> None:
    scan = LidarScan(np.ones((4, 3), np.float32), None, TIME_NS)
    assert "/velodyne/points" in topics_of(frame_messages(recorded(scan=scan)))
    other = frame_messages(recorded(scan=replace(scan, frame="elsewhere")))
    assert "/velodyne/points" not in topics_of(other)


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_a_picture_with_depth(tmp_path: Path, profile: Any) -> None:
    depth_m = np.full((16, 32), 2.5, np.float32)
    depth_m[0] = np.nan
    frame = DepthFrame(
        np.full((16, 32), 77, np.uint8), DepthMap(depth_m), Camera(K, 32, 16), "a", 0, TIME_NS
    )
    cloud = PointCloud(np.ones((5, 3), np.float32), "camera_left")
    content = McapContent(profile=profile)
    messages = frame_messages(frame, cloud=cloud, content=content)
    with McapLog(tmp_path / "a.mcap", prolog(content)) as log:
        log.append(pack_frame(messages, index=0))
    topics = set(check_mcap(tmp_path / "a.mcap").messages)
    assert topics >= {"/camera/depth", "/points", "/frame", "/tf"}
    if profile == "foxglove":
        found = decoded(tmp_path / "b.mcap", messages)
        mm = np.frombuffer(found["/camera/depth"].data, "<u2").reshape(16, 32)
        assert set(mm[0]) == {0}
        assert set(mm[1:].ravel()) == {2500}
        assert found["/camera/calibration"].frame_id == "camera_left"
        edges = [(t.parent_frame_id, t.child_frame_id) for t in found["/tf"].transforms]
        assert edges == [("map", "odom"), ("odom", "base_link"), ("base_link", "camera_left")]


# --- Draco ----------------------------------------------------------------------------------


def unpacked_draco(data: bytes) -> dict[str, np.ndarray[Any, Any]]:
    library = pytest.importorskip("DracoPy")
    cloud = library.decode(data)
    columns = dict(zip("xyz", cloud.points.T, strict=True))
    columns |= dict(zip(("red", "green", "blue", "alpha"), np.asarray(cloud.colors).T, strict=True))
    others = [a for a in cloud.attributes if a["name"]]
    return columns | {a["name"]: a["data"][:, 0] for a in others}


@pytest.mark.parametrize("extent_m", [0.1, 30.0, 160.0, 5000.0])
def test_draco_keeps_every_column_and_places_to_a_millimetre(extent_m: float) -> None:
    cloud = full_cloud(4000)
    rng = np.random.default_rng(1)
    xyz = (rng.random((4000, 3)) - 0.3) * extent_m
    numbers = np.arange(4000, dtype=np.uint32)
    cloud = replace(cloud, xyz=xyz.astype(np.float32), extra={**cloud.extra, "number": numbers})
    columns = cloud_columns(cloud)
    found = unpacked_draco(encode_draco(columns))
    assert found.keys() == columns.keys()
    order = found["number"]
    assert sorted(order) == list(range(4000))
    for axis in "xyz":
        off_m = np.abs(found[axis] - columns[axis][order])
        # Rounding of float32 besides.
        assert off_m.max() <= ERROR_M + extent_m * 2e-7
    assert np.abs(found["x"] - columns["x"][order]).max() > 0
    for name in columns.keys() - {*"xyz", "height_m", "track"}:
        np.testing.assert_array_equal(found[name], columns[name][order], err_msg=name)
    # What Draco has no type for is float32.
    np.testing.assert_array_equal(found["height_m"], columns["height_m"][order].astype(np.float32))


def test_a_recording_of_draco(tmp_path: Path) -> None:
    content = McapContent(cloud_format="draco")
    messages = frame_messages(full_frame(), cloud=full_cloud(), content=content)
    found = decoded(tmp_path / "a.mcap", messages)
    packed = found["/stereo/points/draco"]
    assert (packed.format, packed.frame_id) == ("draco", "velodyne")
    assert len(unpacked_draco(packed.data)["x"]) == 20_000
    assert check_mcap(tmp_path / "a.mcap").frames == 1
    empty = frame_messages(full_frame(), cloud=full_cloud()[:0], content=content)
    assert "/stereo/points/draco" not in topics_of(empty)


def test_draco_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(MissingDependency, match=r"pseudolidar\[draco\]"):
        encode_draco({axis: np.zeros(3, np.float32) for axis in "xyz"})


def test_draco_has_no_place_in_ros() -> None:
    with pytest.raises(UsageError, match="Draco"):
        McapContent(profile="ros2", cloud_format="draco")
