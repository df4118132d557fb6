from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationMissing,
    NotRectified,
    PseudolidarError,
    RecordingError,
    SourceEmpty,
    UsageError,
)
from pseudolidar.formats.rigs.rig_json import rig_text
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.frame import RawPair, StereoFrame
from pseudolidar.structures.recorded import DepthFrame, RecordedCloud
from tests.recordings import (
    DELAY_NS,
    PERIOD_NS,
    START_NS,
    FoxgloveWriter,
    fox_cloud,
    fox_transforms,
    foxglove_messages,
    header,
    named_clouds,
    ros2_messages,
    ros_camera,
    ros_cloud,
    ros_compressed,
    ros_image,
    ros_transforms,
    scan_records,
    small_drive,
    write_foxglove,
    write_own,
    write_ros1_bag,
    write_ros2_bag,
    write_ros2_mcap,
)

WRITERS: dict[str, Callable[[Path, list[StereoFrame]], Path]] = {
    "foxglove protobuf": lambda p, d: write_foxglove(p / "a.mcap", d),
    "foxglove json": lambda p, d: write_foxglove(p / "a.mcap", d, encoding="json"),
    "foxglove without chunks": lambda p, d: write_foxglove(p / "a.mcap", d, use_chunking=False),
    "mcap-ros2-support": lambda p, d: write_ros2_mcap(p / "a.mcap", ros2_messages(d)),
    "rosbags db3": lambda p, d: write_ros2_bag(p / "bag", ros2_messages(d)),
    "rosbags mcap, raw": lambda p, d: write_ros2_bag(p / "bag", ros2_messages(d, raw=True), "mcap"),
}


@pytest.fixture(scope="module")
def drive() -> list[StereoFrame]:
    return small_drive(4)


# --- pairs ----------------------------------------------------------------------------------


@pytest.mark.parametrize("writer", WRITERS)
def test_pairs_of_every_writer_are_the_frames_that_were_recorded(
    tmp_path: Path, drive: list[StereoFrame], writer: str
) -> None:
    path = WRITERS[writer](tmp_path, drive)
    settings = recognise(str(path))
    assert isinstance(settings, Recording)
    source = pickle.loads(pickle.dumps(settings.open()))
    assert source.yields is StereoFrame
    assert source.ids == ("000000", "000001", "000002", "000003")
    assert source.timestamps_ns == tuple(frame.timestamp_ns for frame in drive)
    for index in (2, 0, 3, 1):
        got, want = source.load(index), drive[index]
        np.testing.assert_array_equal(got.left, want.left)
        np.testing.assert_array_equal(got.right, want.right)
        assert got.rig.baseline_m == want.rig.baseline_m
        assert np.array_equal(got.rig.left.K, want.rig.left.K)
        assert got.scan is not None
        assert want.scan is not None
        np.testing.assert_array_equal(got.scan.xyz, want.scan.xyz)
        np.testing.assert_array_equal(got.scan.reflectance, want.scan.reflectance)
        assert (got.scan.timestamp_ns, got.scan.frame) == (want.scan.timestamp_ns, "velodyne")
        assert got.pose is not None
        assert want.pose is not None
        # A quaternion keeps 15 digits of a rotation.
        np.testing.assert_allclose(got.pose.matrix, want.pose.matrix, atol=1e-12)
        left_velodyne = got.rig.T_left_velodyne, want.rig.T_left_velodyne
        np.testing.assert_allclose(*(pose.matrix for pose in left_velodyne if pose), atol=1e-12)


def test_a_mono_pair_in_two_bits_depths(tmp_path: Path) -> None:
    """16 bits stay 16 bits."""
    (frame,) = small_drive(1, grey=True)
    deep = replace(
        frame, left=frame.left.astype(np.uint16) * 257, right=frame.right.astype(np.uint16) * 257
    )
    messages = [
        (topic, message, filed)
        for topic, message, filed in ros2_messages([frame], raw=True)
        if "image_rect" not in topic
    ]
    for side, pixels in (("left", deep.left), ("right", deep.right)):
        image = ros_image(pixels, frame.timestamp_ns, f"{side}_optical", "mono16")
        messages.append((f"/stereo/{side}/image_rect", image, frame.timestamp_ns + DELAY_NS))
    got = Recording(str(write_ros2_bag(tmp_path / "bag", messages))).open().load(0)
    np.testing.assert_array_equal(got.left, deep.left)
    np.testing.assert_array_equal(got.right, deep.right)


def test_left_and_right_follow_from_the_calibration_and_not_from_names(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    swapped = {"left": "a", "right": "zz"}

    def renamed(topic: str) -> str:
        for side, name in swapped.items():
            topic = topic.replace(f"/{side}/", f"/cam_{name}/")
        return topic

    messages = [(renamed(t), m, f) for t, m, f in foxglove_messages(drive)]
    # The eye that is right comes first in the alphabet.
    swapped["left"], swapped["right"] = "zz", "a"
    exchanged = [(renamed(t), m, f) for t, m, f in foxglove_messages(drive)]
    for name, content in (("a.mcap", messages), ("b.mcap", exchanged)):
        with FoxgloveWriter(tmp_path / name) as writer:
            for topic, message, filed in content:
                writer.write(topic, message, filed)
        frame = Recording(str(tmp_path / name)).open().load(1)
        np.testing.assert_array_equal(frame.left, drive[1].left)


def test_pictures_are_paired_by_stamp_and_lonely_ones_refused(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    """Left 1 and right 2 are lost; filing times lie."""
    messages = []
    for number, (topic, message, _) in enumerate(ros2_messages(drive)):
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        time_ns = START_NS if stamp is None else stamp.sec * 10**9 + stamp.nanosec
        lost = ("left/image" in topic and time_ns == drive[1].timestamp_ns) or (
            "right/image" in topic and time_ns == drive[2].timestamp_ns
        )
        if not lost:
            messages.append((topic, message, START_NS + number * 1_000_000))
    source = Recording(str(write_ros2_bag(tmp_path / "bag", messages))).open()
    assert source.timestamps_ns == (drive[0].timestamp_ns, drive[3].timestamp_ns)
    assert [name for name, _ in source.refused] == ["000001", "000001-right"]
    assert "100 ms" in str(source.refused[0][1])
    for index, frame in enumerate((drive[0], drive[3])):
        np.testing.assert_array_equal(source.load(index).left, frame.left)
        np.testing.assert_array_equal(source.load(index).right, frame.right)


def test_eyes_that_are_not_triggered_together_need_a_wider_tolerance(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    messages = []
    for topic, message, filed in ros2_messages(drive):
        if "right/image" in topic:
            late = message.header.stamp.nanosec + 8_000_000
            message.header.stamp.nanosec = late  # below one second: a drive of 0.4 s
        messages.append((topic, message, filed))
    path = write_ros2_bag(tmp_path / "bag", messages)
    with pytest.raises(SourceEmpty, match=r"8 ms apart.*tolerance") as caught:
        Recording(str(path), take="pairs").open()
    assert "/stereo/left/image_rect" in str(caught.value)
    assert len(Recording(str(path), tolerance_s=0.01).open().ids) == 4


@pytest.mark.parametrize("lens", ["plumb_bob", "of my own"])
def test_pictures_that_are_not_rectified_are_taken_as_such_or_refused_with_the_reason(
    lens: str, tmp_path: Path, drive: list[StereoFrame]
) -> None:
    frame = drive[0]
    messages = []
    for side, pixels, P in (
        ("left", frame.left, frame.rig.P_left),
        ("right", frame.right, frame.rig.P_right),
    ):
        place, time_ns = f"/stereo/{side}", frame.timestamp_ns
        info = ros_camera(frame.rig.left.K, P, (96, 48), time_ns, side, D=(-0.3, 0.1, 0, 0, 0))
        info.distortion_model = lens
        messages += [
            (f"{place}/camera_info", info, time_ns),
            (f"{place}/image_raw", ros_image(pixels, time_ns, side, "rgb8"), time_ns),
        ]
    path = write_ros2_bag(tmp_path / "bag", messages)
    if lens == "plumb_bob":
        raw = Recording(str(path)).open()
        assert raw.yields is RawPair
        assert raw.rig is not None
        assert raw.rig.left.distortion.tolist() == [-0.3, 0.1, 0, 0]
        assert raw.rig.baseline_m == pytest.approx(frame.rig.baseline_m)
        pair = raw.load(0)
        assert isinstance(pair, RawPair)
        np.testing.assert_array_equal(pair.left, frame.left)
    with pytest.raises(NotRectified, match="image_rect") as caught:
        Recording(str(path), pictures="rectified" if lens == "plumb_bob" else "auto").open()
    assert "-0.3" in caught.value.got
    if lens == "plumb_bob":
        return
    # With clouds in it those are taken, and it is said why not the pairs.
    cloud = ros_cloud(scan_records(frame.scan), START_NS, "velo_link")  # type: ignore[arg-type]
    both = write_ros2_bag(tmp_path / "both", [*messages, ("/points", cloud, START_NS)])
    source = Recording(str(both)).open()
    assert source.yields is RecordedCloud
    assert any("pairs not taken" in note for note in source.summary.notes)
    with pytest.raises(NotRectified):
        Recording(str(both), take="pairs").open()


def test_pictures_without_calibration_take_a_rig(tmp_path: Path, drive: list[StereoFrame]) -> None:
    messages = [m for m in ros2_messages(drive) if "camera_info" not in m[0]]
    path = write_ros2_bag(tmp_path / "bag", messages)
    assert Recording(str(path)).open().yields is RecordedCloud  # the scans
    rig = tmp_path / "rig.json"
    rig.write_text(rig_text(drive[0].rig))
    source = Recording(str(path), rig=str(rig)).open()
    np.testing.assert_array_equal(source.load(2).right, drive[2].right)
    assert source.load(2).scan is not None
    names = "/stereo/right/image_rect/compressed,/stereo/left/image_rect/compressed"
    crossed = Recording(str(path), rig=str(rig), topics=names).open()
    np.testing.assert_array_equal(crossed.load(0).left, drive[0].right)
    with pytest.raises(UsageError, match="/stereo/left/image_rect"):
        Recording(str(path), rig=str(rig), topics="/nothing,/there").open()
    with pytest.raises(CalibrationMissing, match="camera_info"):
        Recording(str(path), topics=names).open()


def test_poses_are_interpolated_between_transforms(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    """Transforms by another publisher, between the pictures and by turns with others."""
    messages = [m for m in ros2_messages(drive) if m[0] != "/tf"]
    poses = {f.timestamp_ns: f.pose for f in drive}
    from pseudolidar.geometry.frame_chain import between

    for step in range(-1, 16):
        time_ns = START_NS + step * PERIOD_NS // 4 - PERIOD_NS // 8
        at = (time_ns - START_NS) / PERIOD_NS
        early = min(max(int(np.floor(at)), 0), 2)
        a, b = drive[early].pose, drive[early + 1].pose
        assert a is not None
        assert b is not None
        pose = between(a, b, at - early)
        messages.append(("/tf", ros_transforms([pose], time_ns), time_ns + DELAY_NS))
        other = replace(pose, dst="base_link", src=f"wheel_{step % 3}")
        messages.append(("/tf", ros_transforms([other], time_ns), time_ns + DELAY_NS))
    source = Recording(str(write_ros2_bag(tmp_path / "bag", messages))).open()
    for index, time_ns in enumerate(source.timestamps_ns):
        pose = source.load(index).pose
        assert pose is not None
        expected = poses[time_ns]
        assert expected is not None
        # Turns of 20 mrad a frame: the arc between two samples is all but a straight line.
        np.testing.assert_allclose(pose.matrix, expected.matrix, atol=1e-3)


def test_a_recording_with_nothing_to_take_says_what_it_has(tmp_path: Path) -> None:
    with FoxgloveWriter(tmp_path / "a.mcap") as writer:
        writer.write("/tf", fox_transforms([], START_NS), START_NS)
        writer.write_bytes("/odd", "my.Type", b"", b"\x01", START_NS, encoding="cbor")
    with pytest.raises(SourceEmpty, match=r"/tf \(transforms, 1\).*/odd \(1 messages\)"):
        Recording(str(tmp_path / "a.mcap")).open()


def test_pairs_of_this_package_are_the_frames_with_their_whole_rig(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    """The disparity correction is in the attached rig alone; PNG keeps the pictures."""
    correction = DisparityCorrection(np.linspace(-0.3, 0.4, 10), 0.1, "test")
    frames = [replace(f, rig=f.rig.with_correction(correction), pose=None) for f in drive]
    write_own(tmp_path / "a.mcap", frames, images="png")
    source = Recording(str(tmp_path / "a.mcap"), take="pairs").open()
    assert source.ids == tuple(frame.id for frame in frames)
    for index, want in enumerate(frames):
        got = source.load(index)
        np.testing.assert_array_equal(got.left, want.left)
        np.testing.assert_array_equal(got.right, want.right)
        assert got.rig.correction is not None
        np.testing.assert_array_equal(got.rig.correction.coefficients, correction.coefficients)
        assert got.pose is None
        assert got.scan is not None
        assert want.scan is not None
        np.testing.assert_array_equal(got.scan.xyz, want.scan.xyz)


# --- clouds ---------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_clouds_of_this_package_come_back_with_names_and_dtypes(
    tmp_path: Path, profile: str, compression: str, assert_same_cloud: Callable[..., None]
) -> None:
    frames = named_clouds(["b 2", "a", "frame_10"])
    write_own(tmp_path / "a.mcap", frames, profile=profile, compression=compression)
    source = pickle.loads(pickle.dumps(Recording(str(tmp_path / "a.mcap")).open()))
    assert source.ids == ("b 2", "a", "frame_10")
    assert source.timestamps_ns == tuple(frame.timestamp_ns for frame in frames)
    for index, frame in enumerate(frames):
        assert_same_cloud(source.load(index).cloud, frame.cloud)


def test_a_recording_of_this_package_without_clouds_is_its_pairs(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    """As `--mcap.split images,clouds` leaves the pictures."""
    write_own(tmp_path / "a_images.mcap", drive, cloud=False, scan=False, images="png")
    source = Recording(str(tmp_path / "a_images.mcap")).open()
    assert source.ids == tuple(frame.id for frame in drive)
    np.testing.assert_array_equal(source.load(1).left, drive[1].left)


def test_names_from_a_recording_never_leave_the_folder(tmp_path: Path) -> None:
    odd = ["../../up", "/etc/passwd", "CON", "nul\0byte", "x" * 300, "..", "a\\b", "dup", "dup"]
    write_own(tmp_path / "a.mcap", named_clouds(odd))
    source = Recording(str(tmp_path / "a.mcap")).open()
    assert len(set(source.ids)) == len(odd)
    for name in source.ids:
        assert not set("/\\\0") & set(name)
        assert not name.startswith(".")
        assert name.upper() != "CON"
        assert len(name.encode()) <= 200
        assert (tmp_path / f"{name}.pcd").parent == tmp_path
    for index in range(len(odd)):
        assert len(source.load(index).cloud) == 40


def test_the_topic_of_clouds_can_be_chosen(tmp_path: Path, drive: list[StereoFrame]) -> None:
    path = write_ros2_bag(tmp_path / "bag", ros2_messages(drive))
    source = Recording(str(path), topic="/velodyne_points").open()
    assert source.yields is RecordedCloud
    frame = source.load(1)
    assert frame.cloud.frame == "velo_link"
    assert {"map", "base_link", "velo_link"} <= {n for p in frame.tree for n in (p.src, p.dst)}
    with pytest.raises(UsageError, match="/velodyne_points"):
        Recording(str(path), topic="/nope").open()


def test_stamps_of_a_simulation_have_their_own_clock(tmp_path: Path) -> None:
    """Stamps count from the start of the simulation, filing times are of today."""
    drive = [
        replace(frame, timestamp_ns=10**9 + i * PERIOD_NS, scan=None)
        for i, frame in enumerate(small_drive(14))
    ]
    messages = [
        (t, m, START_NS + n * 1_000_000) for n, (t, m, _) in enumerate(ros2_messages(drive))
    ]
    source = Recording(str(write_ros2_bag(tmp_path / "bag", messages))).open()
    assert source.timestamps_ns == tuple(frame.timestamp_ns for frame in drive)
    for index, frame in enumerate(drive):
        pose = source.load(index).pose
        assert pose is not None
        assert frame.pose is not None
        # Without a LiDAR in the recording the body is the camera turned forward.
        turned = pose.matrix[:3, :3] - frame.pose.matrix[:3, :3]
        assert np.abs(turned).max() < 1e-9


# --- depth ----------------------------------------------------------------------------------


def test_a_depth_camera_gives_pictures_with_depth(tmp_path: Path, drive: list[StereoFrame]) -> None:
    """Depth aligned to colour, 3 ms later; one depth has no picture."""
    rig = drive[0].rig
    messages: list[tuple[str, object, int]] = []
    rng = np.random.default_rng(6)
    depths = [rng.integers(0, 9000, (48, 96), np.uint16) for _ in drive]
    for index, (frame, mm) in enumerate(zip(drive, depths, strict=True)):
        time_ns, late_ns = frame.timestamp_ns, frame.timestamp_ns + 3_000_000
        info = ros_camera(rig.left.K, rig.P_left, rig.left.size_px, time_ns, "color_optical")
        for place in ("color", "aligned_depth_to_color"):
            messages.append((f"/camera/{place}/camera_info", info, time_ns))
        colour = ros_image(frame.left, time_ns, "color_optical", "rgb8")
        depth = ros_image(mm, late_ns, "color_optical", "16UC1")
        messages.append(("/camera/aligned_depth_to_color/image_raw", depth, late_ns))
        if index != 2:
            messages.append(("/camera/color/image_raw", colour, time_ns))
    path = write_ros2_bag(tmp_path / "bag", messages, "mcap")
    source = pickle.loads(pickle.dumps(Recording(str(path)).open()))
    assert source.yields is DepthFrame
    assert source.ids == ("000000", "000001", "000003")
    assert any("1 depths without a picture" in note for note in source.summary.notes)
    for place, number in enumerate((0, 1, 3)):
        frame = source.load(place)
        np.testing.assert_array_equal(frame.image, drive[number].left)
        expected = np.where(depths[number] == 0, np.nan, depths[number] / np.float32(1000))
        np.testing.assert_array_equal(frame.depth.values, expected.astype(np.float32))
        assert np.array_equal(frame.camera.K, rig.left.K)
    assert Recording(str(path), take="depth").open().ids == source.ids
    with pytest.raises(SourceEmpty):
        Recording(str(path), take="pairs").open()


# --- topics that cannot be read, damage -----------------------------------------------------


def test_unknown_schemas_and_encodings_are_skipped_and_listed(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    with FoxgloveWriter(tmp_path / "a.mcap") as writer:
        for topic, message, filed in foxglove_messages(drive):
            writer.write(topic, message, filed)
        writer.write_bytes("/radar", "radar.Sweep", b"", b"\x01\x02", START_NS)
        writer.write_bytes("/cbor", "foxglove.PointCloud", b"", b"\xa0", START_NS, encoding="cbor")
        lie = b"\x0a\x03abc"  # no set of descriptors
        writer.write_bytes("/lie", "foxglove.PointCloud", lie, b"", START_NS, encoding="protobuf")
        writer.write_bytes(
            "/idl",
            "my_msgs/msg/Cloud",
            b"struct X;",
            b"\0\1\0\0",
            START_NS,
            encoding="cdr",
            schema_encoding="ros2idl",
        )
    source = Recording(str(tmp_path / "a.mcap")).open()
    (note,) = [note for note in source.summary.notes if note.startswith("topics left out")]
    for topic in ("/radar (1 messages)", "/cbor", "/lie", "/idl"):
        assert topic in note
    np.testing.assert_array_equal(source.load(0).left, drive[0].left)


def test_a_message_that_is_not_what_its_schema_says_costs_its_frame(
    tmp_path: Path, drive: list[StereoFrame]
) -> None:
    path = tmp_path / "a.mcap"
    messages = list(foxglove_messages(drive))
    images = 0
    with FoxgloveWriter(path) as writer:
        for topic, message, filed in messages:
            images += topic == "/left/image"
            if topic == "/left/image" and images == 2:
                writer.write_bytes(topic, "", b"", b"\xff" * 40, filed)
            else:
                writer.write(topic, message, filed)
    source = Recording(str(path)).open()
    (bad,) = [i for i in range(4) if source.timestamps_ns[i] == drive[1].timestamp_ns + DELAY_NS]
    for index in {0, 1, 2, 3} - {bad}:
        source.load(index)
    with pytest.raises(RecordingError, match="/left/image"):
        source.load(bad)


def test_a_file_that_changes_is_noticed(tmp_path: Path, drive: list[StereoFrame]) -> None:
    path = write_foxglove(tmp_path / "a.mcap", drive)
    source = Recording(str(path)).open()
    source.load(0)
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(RecordingError, match="changed since it was opened"):
        source.load(0)


# --- ROS 1 ----------------------------------------------------------------------------------


@pytest.fixture
def ros1_bag(tmp_path: Path, drive: list[StereoFrame]) -> Path:
    return write_ros1_bag(tmp_path / "a.bag", ros2_messages(drive))


def test_a_ros1_bag(ros1_bag: Path, drive: list[StereoFrame]) -> None:
    source = Recording(str(ros1_bag)).open()
    assert source.timestamps_ns == tuple(frame.timestamp_ns for frame in drive)
    for index, want in enumerate(drive):
        got = source.load(index)
        np.testing.assert_array_equal(got.left, want.left)
        assert got.scan is not None
        assert want.scan is not None
        np.testing.assert_array_equal(got.scan.xyz, want.scan.xyz)


def test_a_cut_ros1_bag_keeps_its_whole_chunks(ros1_bag: Path) -> None:
    data = ros1_bag.read_bytes()
    frames = []
    for cut in range(100, len(data), len(data) // 25):
        ros1_bag.write_bytes(data[:cut])
        try:
            source = Recording(str(ros1_bag), take="pairs").open()
        except PseudolidarError:
            frames.append(0)
            continue
        for index in range(len(source.ids)):
            source.load(index)
        assert any(note.startswith("lost: the last") for note in source.summary.notes)
        frames.append(len(source.ids))
    assert frames == sorted(frames)
    assert {1, 2, 3} < set(frames)


@pytest.mark.parametrize("writer", WRITERS)
def test_any_damage_is_a_typed_error_or_a_refused_frame(
    tmp_path: Path, drive: list[StereoFrame], writer: str
) -> None:
    """Flipped bits and cuts: every frame that loads is a frame; nothing else is raised."""
    path = WRITERS[writer](tmp_path, drive[:2])
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")
    data = file.read_bytes()
    rng = np.random.default_rng(3)
    for trial in range(40):
        broken = bytearray(data)
        if trial % 4 == 3:
            broken = broken[: int(rng.integers(9, len(data)))]
        else:
            for at in rng.integers(0, len(data), 1 + trial % 3):
                broken[at] ^= 1 << int(rng.integers(8))
        file.write_bytes(broken)
        try:
            source = Recording(str(path)).open()
        except PseudolidarError:
            continue
        for index in range(len(source.ids)):
            try:
                source.load(index)
            except PseudolidarError:
                continue


def test_headers_have_a_frame(drive: list[StereoFrame]) -> None:
    """The writers of these tests are what they claim to be: stamps and frames are in them."""
    assert header(START_NS, "x").stamp.sec == START_NS // 10**9
    assert ros_compressed(b"1", START_NS, "x").format == "png"
    assert len(list(ros2_messages(drive))) == 4 * 6 + 1


# --- clouds of others, packed ones ----------------------------------------------------------


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_clouds_of_foxglove_with_a_pose_of_their_own(tmp_path: Path, encoding: str) -> None:
    """The pose in the message places the points in its frame; a pose of zeros is none."""
    scan = small_drive(1)[0].scan
    assert scan is not None
    records = scan_records(scan)
    with FoxgloveWriter(tmp_path / "a.mcap", encoding=encoding) as writer:
        for index in range(3):
            message = fox_cloud(records, START_NS + index * PERIOD_NS)
            if index == 1:
                message.pose.position.x = 5.0
                message.pose.orientation.z = 1.0
                message.pose.orientation.w = 0.0
            if index == 2:
                message.pose.orientation.w = 0.0
            writer.write("/lidar", message, START_NS + index * PERIOD_NS)
    source = Recording(str(tmp_path / "a.mcap")).open()
    plain, turned, zero = (source.load(index).cloud for index in range(3))
    np.testing.assert_array_equal(plain.xyz, scan.xyz)
    np.testing.assert_array_equal(zero.xyz, scan.xyz)
    np.testing.assert_allclose(turned.xyz, scan.xyz * [-1, -1, 1] + [5, 0, 0], atol=1e-5)
    np.testing.assert_array_equal(plain.intensity, scan.reflectance)


def test_clouds_packed_by_draco(tmp_path: Path) -> None:
    """Columns to the last digit, coordinates to a millimetre; points in another order."""
    pytest.importorskip("DracoPy")
    (frame,) = named_clouds(["a"], points=500)
    write_own(tmp_path / "a.mcap", [frame], cloud_format="draco")
    got, want = Recording(str(tmp_path / "a.mcap")).open().load(0).cloud, frame.cloud
    assert len(got) == len(want)
    assert want.intensity is not None
    assert got.intensity is not None
    order, expected = np.argsort(got.intensity), np.argsort(want.intensity)
    np.testing.assert_array_equal(got.intensity[order], want.intensity[expected])
    np.testing.assert_allclose(got.xyz[order], want.xyz[expected], atol=0.002)
    assert got.rgb is not None
    assert want.rgb is not None
    np.testing.assert_array_equal(got.rgb[order], want.rgb[expected])
    np.testing.assert_array_equal(got.extra["ring"][order], want.extra["ring"][expected])
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    at = data.find(b"DRACO")
    data[at + 20 : at + 60] = bytes(40)
    (tmp_path / "a.mcap").write_bytes(data)
    with pytest.raises(RecordingError):
        Recording(str(tmp_path / "a.mcap")).open().load(0)
