from __future__ import annotations

import json
import pickle
import random
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from pseudolidar.errors import OutputError, RecordingError, SequenceTime, StructureError
from pseudolidar.formats.mcap.check import check_mcap
from pseudolidar.formats.mcap.content import Compression
from pseudolidar.formats.mcap.foxglove import FOXGLOVE, log_message
from pseudolidar.formats.mcap.frame import FramePart, pack_frame
from pseudolidar.formats.mcap.items import Note
from pseudolidar.formats.mcap.log import McapLog, frames_in, part_path
from pseudolidar.formats.mcap.messages import LogMessage, frame_messages
from pseudolidar.formats.mcap.prolog import describe_recording
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

START_NS = 1_317_013_333_000_000_000
PERIOD_NS = 100_000_000
PROLOG = describe_recording(
    version="0.0",
    settings='{"matcher": "census"}',
    calibration='{"schema": 1}',
    matcher="census",
    source="synthetic:street",
    time="synthetic",
)


def chunk(index: int, *, points: int = 50, compression: Compression = "lz4") -> FramePart:
    K = np.array([[50.0, 0.0, 16.0], [0.0, 50.0, 8.0], [0.0, 0.0, 1.0]])
    T_right_left = Pose.from_rotation(
        "camera_right", "camera_left", np.eye(3), np.array([-0.5, 0.0, 0.0])
    )
    rig = StereoRig(Camera(K, 32, 16), Camera(K, 32, 16, frame="camera_right"), T_right_left)
    rng = np.random.default_rng(index)
    image = rng.integers(0, 255, (16, 32, 3), dtype=np.uint8)
    time_ns = START_NS + index * PERIOD_NS
    frame = StereoFrame(image, image[:, ::-1].copy(), rig, f"{index:06d}", index, time_ns)
    cloud = PointCloud(rng.normal(size=(points, 3)).astype(np.float32), "camera_left")
    return pack_frame(frame_messages(frame, cloud=cloud), index=index, compression=compression)


@pytest.fixture(scope="module")
def chunks() -> list[FramePart]:
    return [chunk(index) for index in range(6)]


def record(path: Path, chunks: Sequence[FramePart]) -> bytes:
    """As the engine does: the frames of the run are known, and those that are held are left."""
    with McapLog(path, PROLOG, committed=[chunk.frame_id for chunk in chunks]) as log:
        for part in chunks[len(log.held) :]:
            log.append(part)
    return path.read_bytes()


def interrupted(path: Path, chunks: Sequence[FramePart]) -> bytes:
    log = McapLog(path, PROLOG)
    for part in chunks:
        log.append(part)
    log.abandon()
    return part_path(path).read_bytes()


# --- what a recording is --------------------------------------------------------------------


@pytest.mark.parametrize("compression", ["lz4", "zstd", "none"])
def test_others_read_it(tmp_path: Path, compression: Compression) -> None:
    frames = [chunk(index, compression=compression) for index in range(3)]
    data = record(tmp_path / "a.mcap", frames)
    list(StreamReader(BytesIO(data), validate_crcs=True).records)
    reader = make_reader(BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) == 3
    assert summary.statistics.message_count == len(list(reader.iter_messages()))
    assert summary.statistics.message_start_time == START_NS
    assert summary.statistics.message_end_time == START_NS + 2 * PERIOD_NS
    backwards = reader.iter_messages(topics=["/frame"], reverse=True)
    assert [message.sequence for _, _, message in backwards] == [2, 1, 0]
    (metadata,) = reader.iter_metadata()
    assert metadata.name == "pseudolidar"
    assert metadata.metadata["time"] == "synthetic"
    (attachment,) = reader.iter_attachments()
    assert (attachment.name, attachment.data) == ("calibration.json", b'{"schema": 1}')
    header = reader.get_header()
    assert (header.profile, header.library) == ("", "pseudolidar")


def test_indexes_lead_to_the_messages(tmp_path: Path, chunks: list[FramePart]) -> None:
    data = record(tmp_path / "a.mcap", chunks)
    summary = make_reader(BytesIO(data)).get_summary()
    assert summary is not None
    for chunk_index in summary.chunk_indexes:
        chunk_record = Chunk.read(
            ReadDataStream(BytesIO(data[chunk_index.chunk_start_offset + 9 :]))
        )
        records, _ = get_chunk_data_stream(chunk_record, validate_crc=True)
        unpacked = records.read(chunk_record.uncompressed_size)
        assert len(chunk_index.message_index_offsets) > 4
        for channel, offset in chunk_index.message_index_offsets.items():
            assert data[offset] == Opcode.MESSAGE_INDEX
            index = MessageIndex.read(ReadDataStream(BytesIO(data[offset + 9 :])))
            assert index.channel_id == channel
            for time_ns, at in index.records:
                opcode, _, of_channel, _, log_time = struct.unpack_from("<BQHIQ", unpacked, at)
                assert (opcode, of_channel, log_time) == (Opcode.MESSAGE, channel, time_ns)


def test_nothing_in_it_depends_on_place_or_time(
    tmp_path: Path, chunks: list[FramePart], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = record(tmp_path / "a.mcap", chunks)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert record(tmp_path / "elsewhere" / "b.mcap", chunks) == first
    assert str(tmp_path).encode() not in first


def test_a_recording_without_frames(tmp_path: Path) -> None:
    data = record(tmp_path / "a.mcap", [])
    assert list(make_reader(BytesIO(data)).iter_messages()) == []
    assert check_mcap(tmp_path / "a.mcap").frames == 0


def test_the_file_takes_its_name_when_it_is_complete(
    tmp_path: Path, chunks: list[FramePart]
) -> None:
    path = tmp_path / "a.mcap"
    with McapLog(path, PROLOG) as log:
        log.append(chunks[0])
        assert not path.exists()
        assert part_path(path).exists()
    assert path.exists()
    assert not part_path(path).exists()
    assert log.summary is not None
    assert log.summary.frames == 1


def test_messages_without_the_mark_of_a_frame_are_refused() -> None:
    message = log_message(Note("a line of the log"), START_NS)
    line = LogMessage(FOXGLOVE, 2, START_NS, message)
    with pytest.raises(StructureError, match="/frame"):
        pack_frame([line], index=0)


def test_a_frame_earlier_than_the_one_before_is_refused(
    tmp_path: Path, chunks: list[FramePart]
) -> None:
    path = tmp_path / "a.mcap"
    with McapLog(path, PROLOG) as log:
        log.append(chunks[1])
        with pytest.raises(SequenceTime, match="000000"):
            log.append(chunks[0])
        log.append(chunks[2])
    assert frames_in(path) == ("000001", "000002")


# --- interrupted and resumed ----------------------------------------------------------------


def test_resumed_after_an_error(tmp_path: Path, chunks: list[FramePart]) -> None:
    whole = record(tmp_path / "whole.mcap", chunks)
    path = tmp_path / "a.mcap"
    with pytest.raises(SequenceTime):
        record(path, [chunks[0], chunks[1], chunks[0]])
    assert not path.exists()
    assert frames_in(part_path(path)) == ("000000", "000001")
    assert record(path, chunks) == whole


def test_cut_at_any_byte(tmp_path: Path, chunks: list[FramePart]) -> None:
    whole = record(tmp_path / "whole.mcap", chunks)
    rng = random.Random(7)
    ends = [0, 1, len(whole) - 1, len(whole), *(rng.randrange(len(whole)) for _ in range(50))]
    for end in ends:
        path = tmp_path / "cut.mcap"
        path.unlink(missing_ok=True)
        part_path(path).write_bytes(whole[:end])
        assert record(path, chunks) == whole, f"cut at byte {end}"


def test_whole_frames_of_a_cut_file_are_kept(tmp_path: Path, chunks: list[FramePart]) -> None:
    part = interrupted(tmp_path / "a.mcap", chunks)
    path = tmp_path / "a.mcap"
    part_path(path).write_bytes(part[: -chunks[-1].nbytes // 2])
    log = McapLog(path, PROLOG, committed=[chunk.frame_id for chunk in chunks])
    log.abandon()
    assert log.held == tuple(chunk.frame_id for chunk in chunks[:-1])


def test_a_flipped_bit_costs_the_frames_from_there_on(tmp_path: Path) -> None:
    # Not compressed: a flipped bit may leave what an lz4 frame unpacks to as it was.
    chunks = [chunk(index, compression="none") for index in range(4)]
    whole = record(tmp_path / "whole.mcap", chunks)
    path = tmp_path / "a.mcap"
    part = bytearray(interrupted(path, chunks))
    third = len(part) - sum(chunk.nbytes for chunk in chunks[2:])
    for offset in (*range(third, third + 60), *range(third, third + chunks[2].nbytes, 97)):
        damaged = bytearray(part)
        damaged[offset] ^= 0x10
        part_path(path).write_bytes(damaged)
        assert frames_in(part_path(path)) == ("000000", "000001"), f"flipped at byte {offset}"
    assert record(path, chunks) == whole


@pytest.mark.parametrize(
    ("committed", "held"),
    [
        (("000000", "000001"), ("000000", "000001")),
        (("000000", "000002"), ("000000",)),
        (("000001",), ()),
        ((), ()),
    ],
)
def test_frames_that_the_run_has_not_committed_are_cut_off(
    tmp_path: Path, chunks: list[FramePart], committed: tuple[str, ...], held: tuple[str, ...]
) -> None:
    path = tmp_path / "a.mcap"
    interrupted(path, chunks)
    log = McapLog(path, PROLOG, committed=committed)
    log.abandon()
    assert log.held == held == frames_in(part_path(path))


def test_killed_after_completion_and_run_again(tmp_path: Path, chunks: list[FramePart]) -> None:
    whole = record(tmp_path / "a.mcap", chunks)
    log = McapLog(tmp_path / "a.mcap", PROLOG, committed=[chunk.frame_id for chunk in chunks])
    assert len(log.held) == len(chunks)
    log.close()
    assert (tmp_path / "a.mcap").read_bytes() == whole


def test_a_part_of_other_settings_is_not_continued(tmp_path: Path, chunks: list[FramePart]) -> None:
    path = tmp_path / "a.mcap"
    interrupted(path, chunks)
    other = describe_recording(version="1", settings="", calibration="", matcher="", source="")
    log = McapLog(path, other, committed=["000000"])
    log.abandon()
    assert log.held == ()


def test_a_recording_of_somebody_else_is_left_alone(
    tmp_path: Path, chunks: list[FramePart]
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n of somebody else")
    with pytest.raises(OutputError, match="another recording of that name"):
        record(path, chunks)
    assert path.read_bytes() == b"\x89MCAP0\r\n of somebody else"
    assert not part_path(path).exists()


def test_started_anew_without_committed_frames(tmp_path: Path, chunks: list[FramePart]) -> None:
    path = tmp_path / "a.mcap"
    interrupted(path, chunks)
    with McapLog(path, PROLOG) as log:
        assert log.held == ()
        log.append(chunks[0])
    assert frames_in(path) == ("000000",)


def test_frames_of_what_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no recording")
    assert frames_in(tmp_path / "text") == frames_in(tmp_path / "absent") == ()


# --- killed, and on a full disk: real processes ---------------------------------------------

CHILD = """
import json, pickle, resource, sys
from pathlib import Path
from typing import BinaryIO
from pseudolidar.errors import OutputError
from pseudolidar.formats.mcap.log import McapLog
path, limit = Path(sys.argv[1]), int(sys.argv[2])
prolog, chunks = pickle.loads(Path(sys.argv[3]).read_bytes())
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    with McapLog(path, prolog, committed=[chunk.frame_id for chunk in chunks]) as log:
        print("ready", flush=True)
        for chunk in chunks[len(log.held):]:
            log.append(chunk)
except OutputError as error:
    print(json.dumps(error.as_dict()))
"""


def child(path: Path, job: Path, *, limit_bytes: int = 0) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", CHILD, str(path), str(limit_bytes), str(job)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_killed_ten_times(tmp_path: Path) -> None:
    chunks = [chunk(index, points=2000) for index in range(300)]
    whole = record(tmp_path / "whole.mcap", chunks)
    path, job = tmp_path / "a.mcap", tmp_path / "job"
    job.write_bytes(pickle.dumps((PROLOG, chunks)))
    rng = random.Random(3)
    kills, held = 0, 0
    for _ in range(10):
        process = child(path, job)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(rng.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        kills += process.returncode == -signal.SIGKILL
        found = len(frames_in(part_path(path)))
        assert found >= held or path.exists()
        held = found
    assert kills >= 3
    assert record(path, chunks) == whole


def test_disk_full(tmp_path: Path, chunks: list[FramePart]) -> None:
    whole = record(tmp_path / "whole.mcap", chunks)
    path, job = tmp_path / "a.mcap", tmp_path / "job"
    job.write_bytes(pickle.dumps((PROLOG, chunks)))
    limit = len(whole) // 2
    output, _ = child(path, job, limit_bytes=limit).communicate(timeout=60)
    error = json.loads(output.splitlines()[-1])
    assert (error["code"], error["exit_code"], error["path"]) == ("OutputError", 5, str(path))
    assert "bytes; " in error["want"]
    assert "free" in error["want"]
    assert not path.exists()
    held = frames_in(part_path(path))
    assert 0 < len(held) < len(chunks)
    # The torn frame was taken back: nothing but whole frames.
    torn = sum(chunk.nbytes for chunk in chunks[len(held) :])
    assert part_path(path).stat().st_size == len(interrupted(tmp_path / "b.mcap", chunks)) - torn
    assert record(path, chunks) == whole


def test_disk_full_at_the_summary(tmp_path: Path, chunks: list[FramePart]) -> None:
    whole = record(tmp_path / "whole.mcap", chunks)
    path, job = tmp_path / "a.mcap", tmp_path / "job"
    job.write_bytes(pickle.dumps((PROLOG, chunks)))
    output, _ = child(path, job, limit_bytes=len(whole) - 10).communicate(timeout=60)
    assert json.loads(output.splitlines()[-1])["code"] == "OutputError"
    assert not path.exists()
    assert len(frames_in(part_path(path))) == len(chunks)
    assert record(path, chunks) == whole


def test_no_permission(tmp_path: Path, chunks: list[FramePart]) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        McapLog(tmp_path / "file" / "a.mcap", PROLOG)


def test_damage_after_writing_is_found(
    tmp_path: Path, chunks: list[FramePart], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    log = McapLog(path, PROLOG)
    log.append(chunks[0])
    with part_path(path).open("r+b") as file:
        file.seek(-10, 2)
        file.write(b"damage")
    with pytest.raises(RecordingError):
        log.close()


def test_what_does_not_read_back_is_refused_and_the_frames_before_stay(
    tmp_path: Path, chunks: list[FramePart], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    whole = record(tmp_path / "whole.mcap", chunks)

    def write_wrong(file: BinaryIO, data: bytes) -> None:
        file.write(bytes(data[:-1]) + bytes([data[-1] ^ 1]) if data else b"")

    with McapLog(path, PROLOG) as log:
        log.append(chunks[0])
        with monkeypatch.context() as broken_disk:
            broken_disk.setattr("pseudolidar.formats.mcap.log.write_all", write_wrong)
            with pytest.raises(OutputError, match="does not read back"):
                log.append(chunks[1])
        for part in chunks[1:]:
            log.append(part)
    assert path.read_bytes() == whole
