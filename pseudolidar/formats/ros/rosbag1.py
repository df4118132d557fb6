"""ROS 1 bags (`.bag`), format 2.0: listed by the indexes behind their chunks, or by unpacking them.

Source: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path

import numpy as np

from pseudolidar.errors import PseudolidarError, RecordingError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.records import broken
from pseudolidar.formats.recordings.message_store import LOST, ROS1, Channel, FileState, Place
from pseudolidar.formats.ros.rosbag1_records import (
    OP_CHUNK,
    OP_CONNECTION,
    OP_INDEX,
    OP_MESSAGE,
    Record,
    header_fields,
    inner_records,
    message_at,
    read_record,
    unpacked,
)
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.structures.arrays import AnyArray, Int64

MAGIC = b"#ROSBAG V2.0\n"
ENTRY = np.dtype([("time", "<i8"), ("chunk", "<i8"), ("offset", "<i8")])
_INDEX_ENTRY = np.dtype([("s", "<u4"), ("ns", "<u4"), ("offset", "<u4")])


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
                        record = read_record(file, start, self.state.size_bytes, self.limits)
                        chunk = unpacked(record, self.limits)
                    found[at] = bytes(message_at(chunk, int(entries[at]["offset"]), start))
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
                        record = read_record(file, start, self.state.size_bytes, self.limits)
                        chunk = unpacked(record, self.limits)
                    except RecordingError:
                        chunk = b""
                try:
                    yield message_at(chunk, int(entry["offset"]), start)[:size]
                except RecordingError:
                    yield b""


class _Listing:
    """One pass over the records of a bag; chunks are unpacked only where no index follows."""

    def __init__(self, file: FileIO, state: FileState, limits: Limits) -> None:
        self._file, self._state, self._limits = file, state, limits
        self._connections: dict[int, Channel] = {}
        self._entries: dict[int, list[AnyArray]] = {}
        self._notes: list[str] = []
        # A chunk whose index records are awaited.
        self._open_chunk: Record | None = None
        self._indexed = False

    def store(self) -> Ros1Store:
        if self._file.read(len(MAGIC)) != MAGIC:
            raise broken("no bag of format 2.0: it begins otherwise", 0)
        offset, size, end = len(MAGIC), self._state.size_bytes, None
        try:
            while offset < size:
                record = read_record(self._file, offset, size, self._limits)
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
                f"{LOST}the last {size - offset} bytes, from byte {offset} on ({end.got}); "
                f"{kept} messages are left"
            )
        return Ros1Store(
            self._state,
            tuple(self._connections[n] for n in known if n in self._connections),
            tuple(part[np.argsort(part["time"], kind="stable")] for part in entries),
            tuple(self._notes),
            self._limits,
        )

    def _add(self, record: Record) -> None:
        if record.op == OP_INDEX and self._open_chunk is not None:
            self._add_index(record, self._open_chunk.offset)
            return
        if record.op == OP_CONNECTION:
            self._connect(record)
        if record.op == OP_CHUNK:
            self._close_chunk()
            self._open_chunk, self._indexed = record, False

    def _add_index(self, record: Record, chunk: int) -> None:
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
            data = unpacked(chunk, self._limits)
            for record in inner_records(data, chunk.offset):
                if record.op == OP_CONNECTION:
                    self._connect(record)
                elif record.op == OP_MESSAGE:
                    time = record.number(b"time")
                    time_ns = (time & 0xFFFFFFFF) * NS_PER_S + (time >> 32)
                    number = record.number(b"conn")
                    rows.setdefault(number, []).append((time_ns, chunk.offset, record.offset))
        except RecordingError as error:
            self._notes.append(f"{LOST}a damaged chunk at {error.where} ({error.got})")
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
                chunk = read_record(self._file, start, self._state.size_bytes, self._limits)
                for record in inner_records(unpacked(chunk, self._limits), start):
                    if record.op == OP_CONNECTION:
                        self._connect(record)
            except RecordingError as error:
                self._notes.append(f"{LOST}a damaged chunk at {error.where} ({error.got})")

    def _connect(self, record: Record) -> None:
        inner = header_fields(record.data, record.offset)
        channel = Channel(
            topic=record.fields.get(b"topic", b"").decode("utf-8", "replace"),
            schema=inner.get(b"type", b"").decode("utf-8", "replace"),
            definition=inner.get(b"message_definition", b""),
            definition_encoding="ros1msg",
            encoding=ROS1,
            latched=inner.get(b"latching") == b"1",
        )
        self._connections.setdefault(record.number(b"conn"), channel)
