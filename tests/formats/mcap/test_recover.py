"""Recordings of `mcap`'s own writer and of ours, damaged in every way, and what is saved."""

from __future__ import annotations

import json
import pickle
import random
import signal
import struct
import subprocess
import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, Header
from mcap.writer import CompressionType, Writer

from pseudolidar.errors import RecordingError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.mcap.check import check_mcap
from pseudolidar.formats.mcap.findings import Findings
from pseudolidar.formats.mcap.log import McapLog, part_path
from pseudolidar.formats.mcap.records import MAGIC, record_bytes
from pseudolidar.formats.mcap.recover import inspect_recording, recover_recording
from tests.formats.mcap.test_log import CHILD, PROLOG, chunk

TIME_NS = 1_317_013_333_000_000_000
# Bytes of the attachment from its name on: name, media type, length, data, CRC.
ATTACHMENT_LEFT = 9 + 4 + 10 + 8 + 6 + 4
TOPICS = ("/scan", "/pose", "/camera")
Message = tuple[str, int, int, int, bytes]


def write(path: Path, *, messages: int = 300, size: int = 200, **options: Any) -> list[Message]:
    """A recording of `mcap`'s writer: random payloads, an attachment and metadata in it."""
    rng = random.Random(1)
    written = []
    with path.open("wb") as file:
        writer = Writer(file, **({"chunk_size": 4000} | options))
        writer.start("", "somebody")
        schema = writer.register_schema("thing", "jsonschema", b'{"type": "object"}')
        ids = {
            topic: writer.register_channel(topic, "json", schema, {"of": topic}) for topic in TOPICS
        }
        writer.add_metadata("settings", {"speed": "3"})
        for number in range(messages):
            topic = TOPICS[number % len(TOPICS)]
            data = rng.randbytes(rng.randrange(size))
            time_ns = TIME_NS + number
            writer.add_message(ids[topic], time_ns, data, time_ns - 5, number)
            written.append((topic, number, time_ns, time_ns - 5, data))
            if number == messages // 2:
                writer.add_attachment(1, 2, "notes.txt", "text/plain", b"a note")
        writer.finish()
    return written


WRITERS: dict[str, dict[str, Any]] = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "uncompressed": {"compression": CompressionType.NONE},
    "unchunked": {"use_chunking": False},
}


def read(path: Path) -> list[Message]:
    """By the library's reader, through the index."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        found = [
            (channel.topic, m.sequence, m.log_time, m.publish_time, m.data)
            for _, channel, m in reader.iter_messages(log_time_order=False)
        ]
        assert summary.statistics.message_count == len(found)
        assert all(
            channel.metadata.get("of") == channel.topic for channel in summary.channels.values()
        )
        return found


def recover(path: Path, **options: Any) -> tuple[Findings, list[Message]]:
    """What is saved, as read back from the new file; the damaged one is as it was."""
    before = path.read_bytes()
    out = path.with_name("out.mcap")
    _, known, compression = inspect_recording(path, **options)
    findings = recover_recording(path, out, known=known, compression=compression, **options)
    assert path.read_bytes() == before
    saved = read(out)
    assert Counter(topic for topic, *_ in saved) == findings.saved
    return findings, saved


@pytest.mark.parametrize("writer", WRITERS)
def test_an_intact_file_is_said_to_be(tmp_path: Path, writer: str) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path, **WRITERS[writer])
    findings, _, _ = inspect_recording(path)
    assert (findings.intact, findings.complete) == (True, True)
    assert findings.saved.total() == len(messages)
    assert (findings.attachments, findings.metadata) == (1, 1)
    assert recover(path)[1] == messages


@pytest.mark.parametrize("writer", WRITERS)
def test_cut_at_any_byte_all_whole_messages_are_saved(tmp_path: Path, writer: str) -> None:
    whole = tmp_path / "a.mcap"
    messages = write(whole, **WRITERS[writer])
    data, path = whole.read_bytes(), tmp_path / "cut.mcap"
    ends = message_ends(data) if writer in ("unchunked", "uncompressed") else None
    rng = random.Random(2)
    first = data.index(b"notes.txt")
    for end in [
        first,
        len(data) - 1,
        len(data) - 8,
        *(rng.randrange(60, len(data)) for _ in range(40)),
    ]:
        path.write_bytes(data[:end])
        findings, saved = recover(path)
        assert not findings.intact
        assert saved == messages[: len(saved)]
        if ends is not None:
            assert len(saved) == sum(at <= end for at in ends), f"cut at byte {end}"
        assert (findings.attachments == 1) == (end >= first + ATTACHMENT_LEFT)


def message_ends(data: bytes) -> list[int]:
    """Byte after each message of a file that is not compressed, found by walking its records."""
    ends, at = [], len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == Opcode.CHUNK:
            name = struct.unpack_from("<I", data, at + 9 + 28)[0]
            inner = at + 9 + 32 + name + 8
            while inner < at + 9 + length:
                inner_opcode, inner_length = struct.unpack_from("<BQ", data, inner)
                inner += 9 + inner_length
                ends += [inner] if inner_opcode == Opcode.MESSAGE else []
        ends += [at + 9 + length] if opcode == Opcode.MESSAGE else []
        at += 9 + length
    return ends


@pytest.mark.parametrize("writer", ["zstd", "lz4", "uncompressed"])
def test_a_flipped_bit_anywhere_costs_a_chunk_at_most(tmp_path: Path, writer: str) -> None:
    whole = tmp_path / "a.mcap"
    messages = write(whole, **WRITERS[writer])
    data, path = whole.read_bytes(), tmp_path / "flipped.mcap"
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    most = max(index.uncompressed_size for index in summary.chunk_indexes) // 31
    rng = random.Random(3)
    told = 0
    for offset in [*range(60), *(rng.randrange(len(data)) for _ in range(80))]:
        damaged = bytearray(data)
        damaged[offset] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        findings, saved = recover(path)
        told += not findings.intact
        # In order, nothing invented, and no more missing than one chunk can hold.
        left = iter(messages)
        assert all(message in left for message in saved), f"flipped at byte {offset}"
        assert len(messages) - len(saved) <= most
        if len(saved) < len(messages):
            assert not findings.complete
            assert findings.losses[0].offset <= offset
    assert told > 100


def test_a_flipped_bit_outside_of_chunks_costs_two_messages_at_most(tmp_path: Path) -> None:
    whole = tmp_path / "a.mcap"
    messages = write(whole, use_chunking=False)
    data, path = whole.read_bytes(), tmp_path / "flipped.mcap"
    rng = random.Random(4)
    for offset in (rng.randrange(400, len(data)) for _ in range(60)):
        damaged = bytearray(data)
        damaged[offset] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        _, saved = recover(path)
        assert len(set(messages) - set(saved)) <= 2, f"flipped at byte {offset}"


@pytest.mark.parametrize("length", [0, 1, 40, 2**20, 2**40, 2**63])
def test_lengths_that_lie(tmp_path: Path, length: int) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    third = summary.chunk_indexes[2]
    struct.pack_into("<Q", data, third.chunk_start_offset + 1, length)
    path.write_bytes(data)
    findings, saved = recover(path)
    missing = set(messages) - set(saved)
    assert 0 < len(missing) < 50
    # Count by topic from the statistics, and the byte where the chunk began.
    assert findings.lost == Counter(topic for topic, *_ in missing)
    assert findings.losses[0].offset == third.chunk_start_offset


def test_a_lost_chunk_is_counted_by_the_indexes_after_it(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    fifth = summary.chunk_indexes[4]
    data[fifth.chunk_start_offset + 100] ^= 1
    # Without the end of the file nothing else tells.
    path.write_bytes(data[: summary.chunk_indexes[-1].chunk_start_offset])
    findings, saved = recover(path)
    assert findings.losses[0].offset == fifth.chunk_start_offset
    assert findings.losses[0].messages == dict(findings.lost)
    gone = [m for m in messages[: len(saved) + findings.lost.total()] if m not in set(saved)]
    assert findings.lost == Counter(topic for topic, *_ in gone)


def test_declarations_of_a_lost_chunk_come_from_the_end_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path)
    data = bytearray(path.read_bytes())
    first = next(
        i for i in range(len(data)) if data[i] == Opcode.CHUNK and data[i + 4 : i + 9] == bytes(5)
    )
    data[first + 200] ^= 1
    path.write_bytes(data)
    _, saved = recover(path)
    assert saved == messages[-len(saved) :]
    assert len(messages) - 50 < len(saved) < len(messages)


def test_damaged_chunks_are_kept_up_to_the_damage_where_that_is_wanted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path, compression=CompressionType.NONE)
    data = bytearray(path.read_bytes())
    ends = message_ends(bytes(data))
    data[ends[100] - 1] ^= 1
    path.write_bytes(data)
    strict, without = recover(path)
    findings, saved = recover(path, keep_damaged=True)
    assert strict.unchecked == 0
    assert len(without) < len(saved) == len(messages)
    assert sum(a != b for a, b in zip(saved, messages, strict=True)) == 1
    assert findings.unchecked == len(saved) - len(without)
    assert not findings.complete


# --- hostile --------------------------------------------------------------------------------

BOMB = zstandard.compress(bytes(64 * 2**20))


def bomb(size: int) -> bytes:
    return record_bytes(
        Chunk(
            compression="zstd",
            data=BOMB,
            message_start_time=1,
            message_end_time=1,
            uncompressed_crc=0,
            uncompressed_size=size,
        )
    )


@pytest.mark.parametrize("keep_damaged", [False, True])
@pytest.mark.parametrize("size", [64 * 2**20, 1000, 2**60])
def test_a_bomb_costs_no_memory_and_nothing_else(
    tmp_path: Path, size: int, keep_damaged: bool
) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path)
    data = path.read_bytes()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    at = summary.chunk_indexes[3].chunk_start_offset
    path.write_bytes(data[:at] + bomb(size) + data[at:])
    tracemalloc.start()
    try:
        findings, saved = recover(path, keep_damaged=keep_damaged)
        assert tracemalloc.get_traced_memory()[1] < 16 * 2**20
    finally:
        tracemalloc.stop()
    assert saved == messages
    assert findings.losses[0].offset == at


def test_records_beyond_the_caps_are_passed_by(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path)
    _, saved = recover(path, limits=Limits(chunk_records=3))
    assert len(saved) < len(messages)
    findings, _, _ = inspect_recording(path, limits=Limits(record_bytes=500))
    assert "bytes" in findings.losses[0].reason


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, messages=240, size=600_000, compression=CompressionType.NONE, chunk_size=10**6)
    assert path.stat().st_size > 50 * 10**6
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 1000)
    _, known, _ = inspect_recording(path)
    tracemalloc.start()
    try:
        recover_recording(path, tmp_path / "out.mcap", known=known, compression="none")
        assert tracemalloc.get_traced_memory()[1] < 30 * 10**6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("content", [b"", b"text that is no recording", MAGIC, bytes(5000)])
def test_what_is_no_recording_has_nothing(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    findings, known, _ = inspect_recording(path)
    assert (findings.saved.total(), known.channels) == (0, {})


def test_random_bytes_are_never_a_crash(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = set(write(path))
    data = path.read_bytes()
    rng = random.Random(5)
    for _ in range(60):
        damaged = bytearray(data)
        for _ in range(rng.randrange(1, 30)):
            begin = rng.randrange(len(data))
            damaged[begin : begin + rng.randrange(40)] = rng.randbytes(rng.randrange(40))
        path.write_bytes(damaged)
        assert set(recover(path)[1]) <= messages


def test_a_header_that_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path)
    path.write_bytes(bytes(40) + path.read_bytes()[40:])
    assert recover(path)[1] == messages
    assert (
        record_bytes(Header(profile="", library="pseudolidar recover"))
        in (tmp_path / "out.mcap").read_bytes()
    )


# --- ours -----------------------------------------------------------------------------------


def ours(path: Path, frames: int) -> list[int]:
    """A `.part` of ours as a killed run leaves it; where its frames end."""
    log, ends = McapLog(path, PROLOG), []
    for index in range(frames):
        log.append(chunk(index))
        ends.append(part_path(path).stat().st_size)
    log.abandon()
    return ends


def test_a_part_of_ours_becomes_a_recording_that_passes_our_check(tmp_path: Path) -> None:
    ends = ours(tmp_path / "a.mcap", 6)
    path = part_path(tmp_path / "a.mcap")
    _, known, compression = inspect_recording(path)
    findings = recover_recording(path, tmp_path / "b.mcap", known=known, compression=compression)
    assert (findings.complete, findings.intact) == (True, False)
    assert check_mcap(tmp_path / "b.mcap").frames == 6
    path.write_bytes(path.read_bytes()[: ends[4] + 100])
    recover_recording(path, tmp_path / "b.mcap", known=known, compression=compression)
    assert check_mcap(tmp_path / "b.mcap").frames == 5


def test_a_recording_killed_in_the_middle_loses_one_frame_at_most(tmp_path: Path) -> None:
    chunks = [chunk(index, points=20_000) for index in range(150)]
    path, job = tmp_path / "a.mcap", tmp_path / "job"
    job.write_bytes(pickle.dumps((PROLOG, chunks)))
    tells = CHILD.replace(
        "log.append(chunk)", "log.append(chunk); print(chunk.frame_id, flush=True)"
    )
    rng = random.Random(6)
    for _ in range(4):
        part_path(path).unlink(missing_ok=True)
        command = [sys.executable, "-c", tells, str(path), "0", str(job)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        told = [process.stdout.readline() for _ in range(rng.randrange(2, 60))][1:]
        process.send_signal(signal.SIGKILL)
        told += process.communicate()[0].splitlines()
        _, known, compression = inspect_recording(part_path(path))
        out = tmp_path / "out.mcap"
        findings = recover_recording(part_path(path), out, known=known, compression=compression)
        assert len(told) <= findings.saved["/frame"] <= len(told) + 1
        assert check_mcap(out).frames == findings.saved["/frame"]


def test_what_was_written_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, out = tmp_path / "a.mcap", tmp_path / "out.mcap"
    write(path)
    _, known, _ = inspect_recording(path)

    def forgetful(self: Any, *args: Any, **kwargs: Any) -> None:
        if kwargs["sequence"] != 100:
            add(self, *args, **kwargs)

    add: Callable[..., None] = Writer.add_message
    monkeypatch.setattr(Writer, "add_message", forgetful)
    with pytest.raises(RecordingError, match="reads back as 299 messages"):
        recover_recording(path, out, known=known, compression="zstd")
    assert not out.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap"]


def test_findings_are_plain(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path)
    findings, _, _ = inspect_recording(path)
    assert json.loads(json.dumps(findings.saved)) == dict.fromkeys(TOPICS, 100)


def test_heads_of_records_at_every_turn_cost_no_hours(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = write(path)
    data = path.read_bytes()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    at = summary.chunk_indexes[3].chunk_start_offset
    fakes = b"".join(struct.pack("<BQ", Opcode.METADATA, 9 * 6000) for _ in range(20_000))
    path.write_bytes(data[:at] + b"\xff" * 3 + fakes + data[at:])
    begin = time.process_time()
    _, saved = recover(path)
    assert time.process_time() - begin < 20
    assert saved == messages
