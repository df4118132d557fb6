"""Recordings written by `mcap`'s own writer, each with one fault, and damaged bytes."""

from __future__ import annotations

import random
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zstandard
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.opcode import Opcode
from mcap.records import Chunk, Header
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_protobuf.writer import Writer as ProtobufWriter

from pseudolidar.errors import RecordingError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.mcap.check import check_mcap
from pseudolidar.formats.mcap.records import MAGIC, record_bytes

TIME_NS = 1_317_013_333_000_000_000
TREE = (("map", "odom"), ("odom", "base_link"), ("base_link", "camera_left"))


def transforms(*edges: tuple[str, str], w: float = 1.0) -> FrameTransforms:
    message = FrameTransforms()
    for parent, child in edges:
        transform = message.transforms.add(parent_frame_id=parent, child_frame_id=child)
        transform.timestamp.FromNanoseconds(TIME_NS)
        transform.rotation.w = w
    return message


def cloud(**changes: Any) -> PointCloud:
    message = PointCloud(frame_id="camera_left", point_stride=12, data=bytes(36))
    message.timestamp.FromNanoseconds(TIME_NS)
    message.pose.orientation.w = 1.0
    for offset, name in enumerate("xyz"):
        message.fields.add(name=name, offset=4 * offset, type=PackedElementField.FLOAT32)
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def changed(message: Any, change: Callable[[Any], object]) -> Any:
    change(message)
    return message


def stamped(message: Any, stamp_ns: int = TIME_NS) -> Any:
    message.timestamp.FromNanoseconds(stamp_ns)
    return message


def calibration(**changes: Any) -> CameraCalibration:
    eye = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    fields = {"K": eye, "R": eye, "P": [1.0] * 12} | changes
    return CameraCalibration(frame_id="camera_left", **fields)


def image(**changes: Any) -> RawImage:
    fields = {"width": 4, "height": 2, "encoding": "16UC1", "step": 8, "data": bytes(16)} | changes
    return RawImage(frame_id="camera_left", **fields)


def picture(data: bytes, kind: str) -> CompressedImage:
    return CompressedImage(frame_id="camera_left", data=data, format=kind)


def write(path: Path, *messages: tuple[str, Any, int]) -> Path:
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for topic, message, time_ns in messages:
            writer.write_message(topic, message, log_time=time_ns, publish_time=time_ns)
    return path


def test_a_sound_recording_of_another_writer(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.mcap",
        ("/tf", transforms(*TREE), TIME_NS),
        ("/points", cloud(), TIME_NS),
        ("/image", stamped(image()), TIME_NS),
        ("/calibration", stamped(calibration()), TIME_NS),
        ("/points", cloud(), TIME_NS + 1),
    )
    summary = check_mcap(path)
    assert summary.messages == {"/calibration": 1, "/image": 1, "/points": 2, "/tf": 1}
    assert (summary.start_ns, summary.end_ns, summary.frames) == (TIME_NS, TIME_NS + 1, 0)
    assert check_mcap(path, every=10) == summary


PNG = b"\x89PNG\r\n\x1a\n...IEND\xaeB`\x82"
FAULTS = {
    "two parents": ("/tf", transforms(*TREE, ("map", "camera_left")), "parents"),
    "two roots": ("/tf", transforms(*TREE, ("world", "drone")), "roots map, world"),
    "a circle": ("/tf", transforms(("a", "b"), ("b", "c"), ("c", "a")), "circle"),
    "a zero quaternion": ("/tf", transforms(*TREE, w=0.0), "quaternion"),
    "a cloud outside the tree": ("/points", cloud(frame_id="/camera_left"), "'/camera_left'"),
    "a stamp of 1970": ("/points", changed(cloud(), lambda m: m.ClearField("timestamp")), "stamp"),
    "a cloud without orientation": (
        "/points",
        changed(cloud(), lambda m: m.ClearField("pose")),
        "quaternion",
    ),
    "a fraction of a point": ("/points", cloud(data=bytes(37)), "37 bytes of points of 12"),
    "a stride below the fields": ("/points", cloud(point_stride=8), "field 'z'"),
    "an untyped field": (
        "/points",
        changed(cloud(), lambda m: setattr(m.fields[1], "type", 0)),
        "'y' without a type",
    ),
    "fields that overlap": (
        "/points",
        changed(cloud(), lambda m: setattr(m.fields[1], "offset", 2)),
        "field 'y' at byte 2",
    ),
    "no z": ("/points", changed(cloud(), lambda m: m.fields.pop()), "fields x, y"),
    "an image with a row missing": ("/image", stamped(image(data=bytes(8))), "8 bytes for 4x2"),
    "rows that overlap": ("/image", stamped(image(step=4, data=bytes(8))), "4 bytes a row"),
    "an unknown encoding": ("/image", stamped(image(encoding="depth")), "encoding 'depth'"),
    "a cut PNG": ("/image", stamped(picture(PNG[:-1], "png")), "no whole png"),
    "a PNG called JPEG": ("/image", stamped(picture(PNG, "jpeg")), "no whole jpeg"),
    "an uncalibrated camera": ("/camera", stamped(calibration(K=[0.0] * 9)), "focal length"),
    "a calibration without P": ("/camera", stamped(calibration(P=[])), "K, R, P"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_messages(tmp_path: Path, fault: str) -> None:
    topic, message, text = FAULTS[fault]
    tree = [] if topic == "/tf" else [("/tf", transforms(*TREE), TIME_NS)]
    path = write(tmp_path / "a.mcap", *tree, (topic, message, TIME_NS))
    with pytest.raises(RecordingError) as caught:
        check_mcap(path)
    assert text in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("times_ns", [(TIME_NS, TIME_NS - 1), (0,)])
def test_times_that_decrease_or_are_none(tmp_path: Path, times_ns: tuple[int, ...]) -> None:
    path = write(tmp_path / "a.mcap", *(("/points", cloud(), time_ns) for time_ns in times_ns))
    with pytest.raises(RecordingError, match=f"time {times_ns[-1]} ns"):
        check_mcap(path)


def test_stamps_that_decrease(tmp_path: Path) -> None:
    clouds = [stamped(cloud(), stamp_ns) for stamp_ns in (TIME_NS, TIME_NS - 1)]
    path = write(tmp_path / "a.mcap", *(("/points", message, TIME_NS) for message in clouds))
    with pytest.raises(RecordingError, match=f"stamp {TIME_NS - 1} ns after {TIME_NS} ns"):
        check_mcap(path)


def written_by_hand(
    path: Path, schema: bytes, *, schema_id: int | None = None, encoding: str = "protobuf"
) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        number = writer.register_schema("foxglove.PointCloud", "protobuf", schema)
        channel = writer.register_channel(
            "/points", encoding, number if schema_id is None else schema_id
        )
        writer.add_message(channel, TIME_NS, cloud().SerializeToString(), TIME_NS)
        writer.finish()
    return path


def test_a_schema_without_its_imports(tmp_path: Path) -> None:
    alone = FileDescriptorSet()
    PointCloud.DESCRIPTOR.file.CopyToProto(alone.file.add())
    path = written_by_hand(tmp_path / "a.mcap", alone.SerializeToString())
    with pytest.raises(RecordingError, match=r"foxglove\.PointCloud.*not complete"):
        check_mcap(path)


@pytest.mark.parametrize("schema", [b"", b"garbage"])
def test_a_schema_that_is_none(tmp_path: Path, schema: bytes) -> None:
    with pytest.raises(RecordingError, match="not complete"):
        check_mcap(written_by_hand(tmp_path / "a.mcap", schema))


def test_a_schema_that_has_other_fields_than_its_name_promises(tmp_path: Path) -> None:
    files = build_file_descriptor_set(PointCloud)
    (stride,) = [field for field in files.file[-1].message_type[0].field if field.number == 4]
    stride.name = "step"
    path = written_by_hand(tmp_path / "a.mcap", files.SerializeToString())
    with pytest.raises(RecordingError, match="not that of its name"):
        check_mcap(path)


def test_a_channel_without_a_schema(tmp_path: Path) -> None:
    schema = build_file_descriptor_set(PointCloud).SerializeToString()
    path = tmp_path / "a.mcap"
    assert check_mcap(written_by_hand(path, schema)).messages == {"/points": 1}
    with pytest.raises(RecordingError, match="without a schema"):
        check_mcap(written_by_hand(path, schema, schema_id=0))
    # JSON needs none.
    assert check_mcap(written_by_hand(path, schema, schema_id=0, encoding="json")).skipped


@pytest.mark.real
def test_a_ros_2_recording_is_counted_and_its_topics_listed(real_data: Path) -> None:
    summary = check_mcap(real_data / "mcap" / "nav2_turtlebot.mcap")
    assert sum(summary.messages.values()) > 0
    assert summary.skipped == tuple(sorted(summary.skipped)) != ()


# --- damaged and hostile bytes --------------------------------------------------------------


@pytest.fixture
def sound(tmp_path: Path) -> bytes:
    points = [("/points", cloud(), TIME_NS + index) for index in range(20)]
    return write(tmp_path / "sound.mcap", ("/tf", transforms(*TREE), TIME_NS), *points).read_bytes()


def test_cut_at_any_byte(tmp_path: Path, sound: bytes) -> None:
    path = tmp_path / "cut.mcap"
    rng = random.Random(5)
    for end in [0, 7, 8, len(sound) - 1, *(rng.randrange(len(sound)) for _ in range(40))]:
        path.write_bytes(sound[:end])
        with pytest.raises(RecordingError, match="byte"):
            check_mcap(path)


@pytest.mark.parametrize(
    ("opcode", "field", "text"),
    [
        # The last 8 bytes of the statistics are the count of the last channel; the chunk index has
        # its offset as third number.
        (Opcode.STATISTICS, slice(-8, None), "statistics that count other messages"),
        (Opcode.CHUNK_INDEX, slice(16, 24), "an index of other chunks"),
    ],
)
def test_a_summary_that_contradicts_the_data(
    tmp_path: Path, opcode: int, field: slice, text: str
) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, enable_crcs=False)
        writer.start()
        schema = build_file_descriptor_set(PointCloud).SerializeToString()
        number = writer.register_schema("foxglove.PointCloud", "protobuf", schema)
        channel = writer.register_channel("/points", "protobuf", number)
        writer.add_message(channel, TIME_NS, cloud().SerializeToString(), TIME_NS)
        writer.finish()
    check_mcap(path)
    data = bytearray(path.read_bytes())
    start, length = body_of(data, opcode)
    begin = (start if field.start >= 0 else start + length) + field.start
    data[begin] += 1
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=text):
        check_mcap(path)


def body_of(data: bytearray, opcode: int) -> tuple[int, int]:
    """Begin and length of the body of the first record of a kind."""
    at = len(MAGIC)
    while data[at] != opcode:
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return at + 9, int.from_bytes(data[at + 1 : at + 9], "little")


def test_bytes_after_the_end(tmp_path: Path, sound: bytes) -> None:
    path = tmp_path / "long.mcap"
    path.write_bytes(sound + b"x")
    with pytest.raises(RecordingError, match="end mark"):
        check_mcap(path)


def test_a_flipped_bit_anywhere_is_never_a_crash(tmp_path: Path, sound: bytes) -> None:
    path = tmp_path / "flipped.mcap"
    chunk = sound.index(b"zstd")
    rng = random.Random(6)
    found = 0
    for offset in [chunk + 100, *(rng.randrange(len(sound)) for _ in range(150))]:
        damaged = bytearray(sound)
        damaged[offset] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            check_mcap(path)
        except RecordingError:
            found += 1
    # That writer puts no CRC on what stands between chunk and summary (indexes of messages).
    assert found > 100


def test_no_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        check_mcap(tmp_path / "absent.mcap")


def chunk_of(data: bytes, *, size: int, compression: str) -> bytes:
    return record_bytes(
        Chunk(
            compression=compression,
            data=data,
            message_start_time=TIME_NS,
            message_end_time=TIME_NS,
            uncompressed_crc=0,
            uncompressed_size=size,
        )
    )


ZEROS = bytes(64 * 2**20)
BOMB = zstandard.compress(ZEROS)


@pytest.mark.parametrize(
    ("chunk", "text"),
    [
        (chunk_of(BOMB, size=len(ZEROS), compression="zstd"), "claims to unpack to 67108864"),
        (chunk_of(BOMB, size=1000, compression="zstd"), "another size"),
        (chunk_of(BOMB, size=2**60, compression="zstd"), "claims to unpack to"),
        (chunk_of(b"x" * 50, size=50, compression="zip"), "unknown compression 'zip'"),
        (chunk_of(b"garbage", size=50, compression="lz4"), "cannot be unpacked"),
        (chunk_of(b"garbage", size=50, compression="zstd"), "cannot be unpacked"),
        (chunk_of(b"\x05" + b"\xff" * 20, size=21, compression=""), "ends within a record"),
        (struct.pack("<BQ", 6, 2**60), "claims 1152921504606846976 bytes where 0 are left"),
    ],
)
def test_chunks_that_lie_cost_no_memory(tmp_path: Path, chunk: bytes, text: str) -> None:
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MAGIC + record_bytes(Header(profile="", library="")) + chunk)
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError, match=text):
            check_mcap(path)
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


def test_an_lz4_bomb_is_unpacked_no_further_than_it_claims(tmp_path: Path) -> None:
    lz4_frame = pytest.importorskip("lz4.frame")
    path = tmp_path / "bomb.mcap"
    chunk = chunk_of(lz4_frame.compress(ZEROS), size=10_000, compression="lz4")
    path.write_bytes(MAGIC + record_bytes(Header(profile="", library="")) + chunk)
    with pytest.raises(RecordingError, match="10001 bytes where it claims 10000"):
        check_mcap(path)


def test_a_record_beyond_the_cap(tmp_path: Path, sound: bytes) -> None:
    path = tmp_path / "sound.mcap"
    with pytest.raises(RecordingError, match=r"limits\.record-bytes"):
        check_mcap(path, limits=Limits(record_bytes=100))
    check_mcap(path)


def test_uncompressed_chunks(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = ProtobufWriter(file, compression=CompressionType.NONE)
        writer.write_message("/points", cloud(), log_time=TIME_NS, publish_time=TIME_NS)
        writer.finish()
    assert check_mcap(path).messages == {"/points": 1}
