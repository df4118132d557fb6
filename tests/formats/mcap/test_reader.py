from __future__ import annotations

import io
import pickle
import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.records import Chunk, Footer
from mcap.writer import CompressionType, IndexType, Writer

from pseudolidar.errors import RecordingError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.mcap.reader import McapStore, open_mcap
from pseudolidar.formats.mcap.records import MAGIC, record_bytes

MESSAGES = 200
PAYLOAD = 300


def recording(path: Path, **settings: object) -> bytes:
    rng = np.random.default_rng(2)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=8192, **settings)  # type: ignore[arg-type]
        writer.start(profile="", library="test")
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channels = [writer.register_channel(f"/{name}", "json", schema) for name in "ab"]
        for number in range(MESSAGES):
            data = struct.pack("<I", number) + rng.bytes(PAYLOAD)
            writer.add_message(channels[number % 2], 1000 + number, data, 1000 + number)
        writer.finish()
    return path.read_bytes()


def everything(store: McapStore) -> list[tuple[str, int, bytes]]:
    found = []
    for channel, described in enumerate(store.channels):
        times = store.times_ns(channel)
        data = store.read([(channel, number) for number in range(len(times))])
        found += [(described.topic, int(t), bytes(d)) for t, d in zip(times, data, strict=True)]
    return sorted(found, key=lambda message: message[1])


LAYOUTS: dict[str, dict[str, object]] = {
    "zstd": {"compression": CompressionType.ZSTD},
    "lz4": {"compression": CompressionType.LZ4},
    "none": {"compression": CompressionType.NONE},
    "no chunks": {"use_chunking": False},
    "no message index": {"index_types": IndexType.CHUNK},
    "no chunk index": {"index_types": IndexType.MESSAGE},
    "no statistics": {"use_statistics": False},
    "no summary": {
        "use_statistics": False,
        "use_summary_offsets": False,
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
    },
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_what_mcaps_own_reader_gives(tmp_path: Path, layout: str) -> None:
    data = recording(tmp_path / "a.mcap", **LAYOUTS[layout])
    store = pickle.loads(pickle.dumps(open_mcap(tmp_path / "a.mcap")))
    expected = [
        (channel.topic, message.log_time, message.data)
        for _, channel, message in make_reader(io.BytesIO(data)).iter_messages()
    ]
    assert everything(store) == expected
    assert store.written_by == "test"
    for channel in range(2):
        heads = [bytes(head) for head in store.heads(channel, 4)]
        assert [struct.unpack("<I", head)[0] for head in heads] == list(range(channel, MESSAGES, 2))
        whole = [bytes(head) for head in store.heads(channel, 10_000)]
        assert whole == [d for _, t, d in expected if t % 2 == channel]


@pytest.mark.parametrize("layout", ["zstd", "lz4", "none", "no chunks"])
def test_cut_anywhere_it_keeps_every_whole_chunk_and_says_what_is_lost(
    tmp_path: Path, layout: str
) -> None:
    path = tmp_path / "a.mcap"
    data = recording(path, **LAYOUTS[layout])
    whole = everything(open_mcap(path))
    kept = []
    for cut in [*range(9, len(data), 997), *range(len(data) - 60, len(data))]:
        path.write_bytes(data[:cut])
        try:
            store = open_mcap(path)
        except RecordingError:
            kept.append(0)
            continue
        found = everything(store)
        assert found == whole[: len(found)]
        assert store.notes[0].startswith("read without its index")
        kept.append(len(found))
    assert kept == sorted(kept)
    # All messages are there long before the end; a chunk holds 26 of them.
    assert kept.count(MESSAGES) >= 60
    for cut, count in zip(range(9, len(data), 997), kept, strict=False):
        assert count >= (cut - 1000) / len(data) * MESSAGES - 30


def test_a_damaged_chunk_costs_its_messages_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = bytearray(recording(path, compression=CompressionType.NONE))
    whole = everything(open_mcap(path))
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    store = open_mcap(path)  # the index is whole: what is damaged shows when it is read
    errors: list[RecordingError] = []
    for channel in range(2):
        for number in range(MESSAGES // 2):
            try:
                store.read([(channel, number)])
            except RecordingError as error:
                errors.append(error)
    failed = len(errors)
    assert all("CRC" in error.got and error.where.startswith("byte ") for error in errors)
    assert 20 <= failed <= 40
    path.write_bytes(data[:-20])  # no index: the scan goes on past the damage
    store = open_mcap(path)
    found = everything(store)
    assert len(found) == MESSAGES - failed
    assert set(found) < set(whole)
    assert f"1 damaged chunks with {failed} messages" in " ".join(store.notes)
    assert "byte" in store.notes[1]


def test_flipped_bits_never_give_other_messages(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = recording(path, compression=CompressionType.ZSTD)
    whole = set(everything(open_mcap(path)))
    rng = np.random.default_rng(4)
    for _ in range(150):
        broken = bytearray(data)
        for at in rng.integers(8, len(data), 3):
            broken[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        try:
            store = open_mcap(path)
        except RecordingError:
            continue
        for channel in range(len(store.channels)):
            for number, time_ns in enumerate(store.times_ns(channel).tolist()):
                try:
                    (found,) = store.read([(channel, number)])
                except RecordingError:
                    continue
                assert any(t == time_ns and d == bytes(found) for _, t, d in whole)


def _zstd_bomb() -> tuple[bytes, int]:
    size = 900 * 2**20
    compressor = zstandard.ZstdCompressor(level=19).compressobj(size=size)
    block = bytes(2**20)
    return b"".join(compressor.compress(block) for _ in range(900)) + compressor.flush(), size


def _chunk(data: bytes, size: int, compression: str = "zstd") -> bytes:
    return record_bytes(
        Chunk(
            compression=compression,
            data=data,
            message_end_time=1,
            message_start_time=0,
            uncompressed_crc=0,
            uncompressed_size=size,
        )
    )


BOMBS: dict[str, Callable[[], bytes]] = {
    "a zstd bomb that says so": lambda: _chunk(*_zstd_bomb()),
    "a zstd bomb that claims little": lambda: _chunk(_zstd_bomb()[0], 1000),
    "a chunk that claims 2^60 bytes": lambda: _chunk(b"x" * 100, 2**60),
    "a record that claims 2^60 bytes": lambda: struct.pack("<BQ", 6, 2**60) + b"x" * 1000,
    "a record of 4 GiB": lambda: struct.pack("<BQ", 6, 2**32) + b"x" * 1000,
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_bombs_are_refused_before_they_expand(tmp_path: Path, bomb: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(MAGIC + BOMBS[bomb]() + record_bytes(Footer(0, 0, 0)) + MAGIC)
    tracemalloc.start()
    began_s = time.process_time()
    with pytest.raises(RecordingError) as caught:
        open_mcap(path)
    took_s, (_, peak) = time.process_time() - began_s, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "byte" in caught.value.where
    assert took_s < 2
    assert peak < 50 * 2**20


def test_the_cap_of_a_record_can_be_raised(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recording(path)
    with pytest.raises(RecordingError, match=r"record_bytes|raise the cap"):
        open_mcap(path, limits=Limits(record_bytes=50))
    assert len(everything(open_mcap(path, limits=Limits(record_bytes=100_000)))) == MESSAGES


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"\x89MCAP0\r\n", b"PK\x03\x04" * 20])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    if content == MAGIC:
        assert open_mcap(path).channels == ()
        return
    with pytest.raises(RecordingError, match=r"a\.mcap"):
        open_mcap(path)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file"):
        open_mcap(tmp_path / "a.mcap")


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    """40 MB of messages, read one by one, never hold more than a few chunks."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        block = np.random.default_rng(1).bytes(400_000)
        for number in range(100):
            writer.add_message(channel, number, block, number)
        writer.finish()
    store = open_mcap(path)
    tracemalloc.start()
    for number in range(100):
        assert len(store.read([(0, number)])[0]) == len(block)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 40 * 2**20
