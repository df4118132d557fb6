"""ROS 1 bags (`.bag`), format 2.0: listed by the indexes behind their chunks, or by unpacking them.

Source: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import numpy as np

from pseudolidar.errors import PseudolidarError, RecordingError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.records import broken
from pseudolidar.formats.recordings.message_store import ROS1, Channel, FileState, Place
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.structures.arrays import AnyArray, Int64

MAGIC = b"#ROSBAG V2.0\n"
_OP_MESSAGE, _OP_INDEX, _OP_CHUNK, _OP_CONNECTION = 2, 4, 5, 7
_LENGTH = struct.Struct("<I")
_INDEX_ENTRY = np.dtype([("s", "<u4"), ("ns", "<u4"), ("offset", "<u4")])
ENTRY = np.dtype([("time", "<i8"), ("chunk", "<i8"), ("offset", "<i8")])
MOST_HEADER_BYTES = 2**20


def open_bag(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> Ros1Store:
    """Open a ROS 1 bag, complete or cut.

    Raises:
        RecordingError: no such file, no bag, or not one message in it.
    """
    state = FileState.of(path)
    try:
        with FileIO(path, "rb") as file:
            return _Listing(file, state, limits).store()
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__
    except OSError as error:
        raise RecordingError(error.strerror or str(error), want="a bag", path=path) from error


@dataclass(frozen=True, eq=False)
class Ros1Store:
    """An opened ROS 1 bag; see `MessageStore`. Bags have no check sums but bzip2's and LZ4's.

    Args:
        state: the file.
        channels: its connections that have messages.
        entries: by channel, `ENTRY` of each message, by time.
        notes: what is lost.
        limits: caps.
    """

    state: FileState
    channels: tuple[Channel, ...]
    entries: tuple[AnyArray, ...] = field(repr=False)
    notes: tuple[str, ...]
    limits: Limits
    written_by: str = "rosbag"

    def attachment(self, name: str) -> bytes:  # noqa: ARG002
        """None: bags carry no files."""
        return b""

    def times_ns(self, channel: int) -> Int64:
        """(N,) times of a connection."""
        return np.ascontiguousarray(self.entries[channel]["time"])

    def read(self, places: Sequence[Place]) -> list[bytes | memoryview]:
        """Messages; each chunk that they are in is read once.

        Raises:
            RecordingError: damaged.
        """
        self.state.check()
        chunk, start = b"", -1
        found: dict[int, bytes] = {}
        entries = [self.entries[channel][number] for channel, number in places]
        try:
            with FileIO(self.state.path, "rb") as file:
                for at in sorted(range(len(entries)), key=lambda n: int(entries[n]["chunk"])):
                    if int(entries[at]["chunk"]) != start:
                        start = int(entries[at]["chunk"])
                        record = _read_record(file, start, self.state.size_bytes, self.limits)
                        chunk = _unpacked(record, self.limits)
                    found[at] = bytes(_message(chunk, int(entries[at]["offset"]), start))
        except PseudolidarError as error:
            raise error.located(self.state.path) from error.__cause__
        return [found[at] for at in range(len(places))]

    def heads(self, channel: int, size: int) -> Iterator[bytes | memoryview]:
        """First bytes of each message of a connection; chunks are unpacked one after the other."""
        chunk, start = b"", -1
        with FileIO(self.state.path, "rb") as file:
            for entry in self.entries[channel]:
                if int(entry["chunk"]) != start:
                    start = int(entry["chunk"])
                    try:
                        record = _read_record(file, start, self.state.size_bytes, self.limits)
                        chunk = _unpacked(record, self.limits)
                    except RecordingError:
                        chunk = b""
                try:
                    yield _message(chunk, int(entry["offset"]), start)[:size]
                except RecordingError:
                    yield b""


@dataclass(frozen=True)
class _Record:
    """A record: its header's fields, its data, and where it begins and ends."""

    fields: dict[bytes, bytes]
    data: bytes | memoryview
    offset: int
    end: int

    @property
    def op(self) -> int:
        return self.fields.get(b"op", b"\0")[0]

    def number(self, name: bytes) -> int:
        value = self.fields.get(name, b"")
        if not 1 <= len(value) <= 8:
            raise broken(f"a record without {name.decode()}", self.offset)
        return int.from_bytes(value, "little")


class _Listing:
    """One pass over the records of a bag; chunks are unpacked only where no index follows."""

    def __init__(self, file: FileIO, state: FileState, limits: Limits) -> None:
        self._file, self._state, self._limits = file, state, limits
        self._connections: dict[int, Channel] = {}
        self._entries: dict[int, list[AnyArray]] = {}
        self._notes: list[str] = []
        # A chunk whose index records are awaited.
        self._open_chunk: _Record | None = None
        self._indexed = False

    def store(self) -> Ros1Store:
        if self._file.read(len(MAGIC)) != MAGIC:
            raise broken("no bag of format 2.0: it begins otherwise", 0)
        offset, size, end = len(MAGIC), self._state.size_bytes, None
        try:
            while offset < size:
                record = _read_record(self._file, offset, size, self._limits)
                self._add(record)
                offset = record.end
        except RecordingError as error:
            end = error
            self._drop_index()
        self._close_chunk()
        self._find_connections()
        known = {number: parts for number, parts in sorted(self._entries.items()) if parts}
        entries = [np.concatenate(known[n]) for n in known if n in self._connections]
        if end is not None:
            if not entries:
                raise end
            kept = sum(map(len, entries))
            self._notes.append(
                f"lost: the last {size - offset} bytes, from byte {offset} on ({end.got}); "
                f"{kept} messages are left"
            )
        return Ros1Store(
            self._state,
            tuple(self._connections[n] for n in known if n in self._connections),
            tuple(part[np.argsort(part["time"], kind="stable")] for part in entries),
            tuple(self._notes),
            self._limits,
        )

    def _add(self, record: _Record) -> None:
        if record.op == _OP_INDEX and self._open_chunk is not None:
            self._add_index(record, self._open_chunk.offset)
            return
        if record.op == _OP_CONNECTION:
            self._connect(record)
        if record.op == _OP_CHUNK:
            self._close_chunk()
            self._open_chunk, self._indexed = record, False

    def _add_index(self, record: _Record, chunk: int) -> None:
        self._indexed = True
        listed = np.frombuffer(record.data[: len(record.data) // 12 * 12], _INDEX_ENTRY)
        entries = np.empty(len(listed), ENTRY)
        entries["time"] = listed["s"].astype(np.int64) * NS_PER_S + listed["ns"]
        entries["chunk"], entries["offset"] = chunk, listed["offset"]
        self._entries.setdefault(record.number(b"conn"), []).append(entries)

    def _close_chunk(self) -> None:
        """A chunk that no index followed is unpacked and listed message by message."""
        chunk, self._open_chunk = self._open_chunk, None
        if chunk is None or self._indexed:
            return
        rows: dict[int, list[tuple[int, int, int]]] = {}
        try:
            data = _unpacked(chunk, self._limits)
            for record in _inner_records(data, chunk.offset):
                if record.op == _OP_CONNECTION:
                    self._connect(record)
                elif record.op == _OP_MESSAGE:
                    time = record.number(b"time")
                    time_ns = (time & 0xFFFFFFFF) * NS_PER_S + (time >> 32)
                    number = record.number(b"conn")
                    rows.setdefault(number, []).append((time_ns, chunk.offset, record.offset))
        except RecordingError as error:
            self._notes.append(f"lost: a damaged chunk at {error.where} ({error.got})")
            return
        for number, own in rows.items():
            self._entries.setdefault(number, []).append(np.array(own, ENTRY))

    def _drop_index(self) -> None:
        """Where a file ends, the index of its last chunk may be cut: the chunk is listed itself."""
        if self._open_chunk is not None:
            start, self._indexed = self._open_chunk.offset, False
            for number, parts in self._entries.items():
                self._entries[number] = [p for p in parts if not (p["chunk"] == start).any()]

    def _find_connections(self) -> None:
        """Connections are told at the end of a bag, and in the chunk of their first message."""
        for number, parts in self._entries.items():
            if number in self._connections or not parts:
                continue
            try:
                start = int(parts[0]["chunk"][0])
                chunk = _read_record(self._file, start, self._state.size_bytes, self._limits)
                for record in _inner_records(_unpacked(chunk, self._limits), start):
                    if record.op == _OP_CONNECTION:
                        self._connect(record)
            except RecordingError as error:
                self._notes.append(f"lost: a damaged chunk at {error.where} ({error.got})")

    def _connect(self, record: _Record) -> None:
        inner = _fields(record.data, record.offset)
        channel = Channel(
            topic=record.fields.get(b"topic", b"").decode("utf-8", "replace"),
            schema=inner.get(b"type", b"").decode("utf-8", "replace"),
            definition=inner.get(b"message_definition", b""),
            definition_encoding="ros1msg",
            encoding=ROS1,
            latched=inner.get(b"latching") == b"1",
        )
        self._connections.setdefault(record.number(b"conn"), channel)


def _read_record(file: FileIO, offset: int, size: int, limits: Limits) -> _Record:
    """The record at `offset`; the data of a chunk is read, too."""
    file.seek(offset)
    header = _sized(file, offset, size, MOST_HEADER_BYTES)
    data = _sized(file, file.tell(), size, limits.record_bytes)
    return _Record(_fields(header, offset), data, offset, file.tell())


def _sized(file: FileIO, at: int, size: int, most: int) -> bytes:
    head = file.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise broken(f"the file ends after {size} bytes, within a record", at)
    (length,) = _LENGTH.unpack(head)
    if length > min(most, size - at - _LENGTH.size):
        raise broken(f"a record that claims {length} bytes", at)
    return file.read(length)


def _fields(data: bytes | memoryview, offset: int) -> dict[bytes, bytes]:
    found, at = {}, 0
    while at + _LENGTH.size <= len(data):
        (length,) = _LENGTH.unpack_from(data, at)
        at += _LENGTH.size
        name, equals, value = bytes(data[at : at + length]).partition(b"=")
        if at + length > len(data) or not equals:
            raise broken("a header that cannot be read", offset)
        found[name] = value
        at += length
    return found


def _inner_records(data: bytes, offset: int, at: int = 0) -> Iterator[_Record]:
    view = memoryview(data)
    while at < len(data):
        start = at
        parts = []
        for _ in range(2):
            if at + _LENGTH.size > len(data):
                raise broken("a chunk that ends within a record", offset)
            (length,) = _LENGTH.unpack_from(data, at)
            parts.append(view[at + _LENGTH.size :][:length])
            at += _LENGTH.size + length
        if at > len(data):
            raise broken("a chunk that ends within a record", offset)
        yield _Record(_fields(parts[0], offset), parts[1], start, at)


def _message(chunk: bytes, offset: int, start: int) -> memoryview:
    """The message at `offset` of an unpacked chunk; its connection may stand before it."""
    for record in _inner_records(chunk, start, offset):
        if record.op == _OP_MESSAGE:
            return memoryview(record.data)
        if record.op != _OP_CONNECTION:
            break
    raise broken("no message where the index has one", start)


def _unpacked(chunk: _Record, limits: Limits) -> bytes:
    """The records of a chunk, to no more than it claims and the caps allow."""
    size, name = chunk.number(b"size"), chunk.fields.get(b"compression", b"")
    if chunk.op != _OP_CHUNK or size > min(
        limits.chunk_bytes, max(2**20, len(chunk.data) * limits.chunk_expansion)
    ):
        raise RecordingError(
            f"a chunk of {len(chunk.data)} bytes that claims to unpack to {size}",
            want=f"at most {limits.chunk_bytes}, and {limits.chunk_expansion} times its size",
            where=f"byte {chunk.offset}",
        )
    try:
        if name == b"bz2":
            data = bz2.BZ2Decompressor().decompress(chunk.data, size + 1)
        elif name == b"lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
        elif name == b"none":
            data = bytes(chunk.data)
        else:
            raise ValueError(f"unknown compression {name.decode(errors='replace')!r}")
    except (OSError, ValueError, EOFError, RuntimeError) as error:
        raise broken(f"a chunk that cannot be unpacked: {error}", chunk.offset) from error
    if len(data) != size:
        raise broken(f"a chunk of {len(data)} bytes that claims {size}", chunk.offset)
    return data
