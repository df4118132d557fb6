"""MCAP recordings of anybody, read message by message.

By their index, or where that is missing or damaged by a scan that goes on past damaged chunks.
`mcap.reader` is not used for it: it does not check CRCs by default, unpacks what a chunk claims
without a cap, and gives up a file without a footer.
"""

from __future__ import annotations

import struct
import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment

from pseudolidar.errors import PseudolidarError, RecordingError
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.compression import decompressed_start
from pseudolidar.formats.mcap.listing import NO_CHUNK, contents_of
from pseudolidar.formats.mcap.records import (
    CHUNK_START,
    DATA_LENGTH,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    PackedChunk,
    RawRecord,
    broken,
    parse_message,
    parsed,
    read_record,
    record_head,
    unpacked,
)
from pseudolidar.formats.recordings.message_store import Channel, FileState, Place
from pseudolidar.structures.arrays import AnyArray, Int64

_BEFORE_MESSAGES = (Opcode.HEADER, Opcode.METADATA, Opcode.ATTACHMENT)
# The end of an attachment: CRC of its fields.
ATTACHMENT_CRC = struct.Struct("<I")
# Bytes of a compression's name that are looked at.
LONGEST_NAME = 32
# Unpacked chunks that are kept: neighbouring messages of others often share one.
CACHE_BYTES = 32 * 2**20
# A message that is a smaller part of its chunk is copied out of it: 1 / this.
SMALL_PART = 4


def open_mcap(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> McapStore:
    """Open a recording, complete, cut or damaged.

    Raises:
        RecordingError: no such file, no MCAP, or not one message in it.
    """
    state = FileState.of(path)
    try:
        with FileIO(path, "rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise broken("no MCAP file: it begins otherwise", 0)
            contents = contents_of(file, state.size_bytes, limits)
    except OSError as error:
        raise RecordingError(error.strerror or str(error), want="a recording", path=path) from error
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__
    return McapStore(
        state, contents.channels, contents.entries, contents.library, contents.notes, limits
    )


@dataclass(frozen=True, eq=False)
class McapStore:
    """An opened MCAP file; see `MessageStore`.

    Args:
        state: the file.
        channels: its channels.
        entries: by channel, `ENTRY` of each message, by time.
        written_by: library and profile of its header.
        notes: what is lost.
        limits: caps.
    """

    state: FileState
    channels: tuple[Channel, ...]
    entries: tuple[AnyArray, ...] = field(repr=False)
    written_by: str
    notes: tuple[str, ...]
    limits: Limits
    _cache: _ChunkCache = field(default_factory=lambda: _ChunkCache(), repr=False)

    def attachment(self, name: str) -> bytes:
        """A file before the first chunk, its CRC checked; empty where there is none.

        Raises:
            RecordingError: damaged.
        """
        try:
            with FileIO(self.state.path, "rb") as file:
                offset = len(MAGIC)
                while offset < self.state.size_bytes:
                    record = read_record(file, offset, self.state.size_bytes, self.limits)
                    if record.opcode not in _BEFORE_MESSAGES:
                        break
                    if record.opcode == Opcode.ATTACHMENT and (found := _named(record, name)):
                        return found
                    offset = record.end
        except PseudolidarError as error:
            raise error.located(self.state.path) from error.__cause__
        return b""

    def times_ns(self, channel: int) -> Int64:
        """(N,) log times of a channel."""
        return np.ascontiguousarray(self.entries[channel]["time"])

    def read(self, places: Sequence[Place]) -> list[bytes | memoryview]:
        """Messages; each chunk that they are in is read once, its CRC checked.

        Raises:
            RecordingError: damaged, or not what the index says.
        """
        entries = [self.entries[channel][number] for channel, number in places]
        by_chunk: dict[int, list[int]] = {}
        for at, entry in enumerate(entries):
            by_chunk.setdefault(int(entry["chunk"]), []).append(at)
        found: dict[int, bytes | memoryview] = {}
        try:
            self.state.check()
            with FileIO(self.state.path, "rb") as file:
                for start, chosen in by_chunk.items():
                    chunk = b"" if start == NO_CHUNK else self._unpacked(file, start)
                    for at in chosen:
                        entry, offset = entries[at], int(entries[at]["offset"])
                        if start == NO_CHUNK:
                            record = read_record(file, offset, self.state.size_bytes, self.limits)
                        else:
                            record = _record_at(chunk, offset, start)
                        data = self._message(record, places[at][0], int(entry["time"]))
                        # A small part must not keep the whole chunk.
                        small = len(data) * SMALL_PART < len(chunk)
                        found[at] = bytes(data) if small else data
        except PseudolidarError as error:
            raise error.located(self.state.path) from error.__cause__
        except OSError as error:
            raise RecordingError(
                error.strerror or str(error), want="a readable file", path=self.state.path
            ) from error
        return [found[at] for at in range(len(places))]

    def heads(self, channel: int, size: int) -> Iterator[bytes | memoryview]:
        """First bytes of each message of a channel; chunks are unpacked up to there, unchecked."""
        self.state.check()
        span = RECORD_HEADER.size + MESSAGE_HEADER.size
        with FileIO(self.state.path, "rb") as file:
            for entry in self.entries[channel]:
                start, offset = int(entry["chunk"]), int(entry["offset"])
                if start == NO_CHUNK:
                    file.seek(offset)
                    part: bytes | memoryview = file.read(span + size)
                else:
                    part = self._part(file, start, offset, span + size)
                length = RECORD_HEADER.unpack_from(part)[1] if len(part) >= span else 0
                yield part[span:][: max(length - MESSAGE_HEADER.size, 0)]

    def _part(self, file: FileIO, start: int, offset: int, size: int) -> bytes | memoryview:
        """Bytes of the unpacked chunk at `start`, fewer where it is damaged."""
        kept = self._cache.get(start)
        if kept is not None:
            return kept[offset : offset + size]
        try:
            _, length = record_head(file, start, self.state.size_bytes, self.limits)
            head = file.read(min(length, CHUNK_START.size + LONGEST_NAME))
            name_bytes = CHUNK_START.unpack_from(head)[-1]
            name = head[CHUNK_START.size :][:name_bytes].decode()
            at = CHUNK_START.size + name_bytes + DATA_LENGTH.size
            begin = start + RECORD_HEADER.size + at
            if name == "":
                file.seek(begin + offset)
                return file.read(size)
            file.seek(begin)
            if offset + size > self.limits.chunk_bytes:
                return b""
            return decompressed_start(file, name, length - at, offset + size)[offset:]
        except (RecordingError, struct.error, UnicodeDecodeError, ValueError):
            return b""

    def _unpacked(self, file: FileIO, start: int) -> bytes | memoryview:
        kept = self._cache.get(start)
        if kept is not None:
            return kept
        record = read_record(file, start, self.state.size_bytes, self.limits)
        if record.opcode != Opcode.CHUNK:
            raise broken(f"an index of a chunk where there is a record {record.opcode}", start)
        records = unpacked(PackedChunk.parse(record), start, self.limits)
        self._cache.add(start, records)
        return records

    def _message(self, record: RawRecord, channel: int, time_ns: int) -> memoryview:
        message = parse_message(record) if record.opcode == Opcode.MESSAGE else None
        if message is None or message.log_time_ns != time_ns:
            raise broken(
                f"no message of {self.channels[channel].topic} at {time_ns} ns, where the index "
                "has one",
                record.offset,
            )
        return message.data


def _named(record: RawRecord, name: str) -> bytes:
    """The content of an attachment of that name."""
    attachment = parsed(Attachment, record)
    if attachment.name != name:
        return b""
    (stated,) = ATTACHMENT_CRC.unpack_from(record.body, len(record.body) - ATTACHMENT_CRC.size)
    if stated not in (0, crc32(record.body[: -ATTACHMENT_CRC.size])):
        raise broken("an attachment whose CRC does not match", record.offset)
    return bytes(attachment.data)


class _ChunkCache:
    """Unpacked chunks, the last used ones; a copy in another process begins empty."""

    def __init__(self) -> None:
        self._chunks: OrderedDict[int, bytes | memoryview] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, start: int) -> bytes | memoryview | None:
        with self._lock:
            if start in self._chunks:
                self._chunks.move_to_end(start)
            return self._chunks.get(start)

    def add(self, start: int, records: bytes | memoryview) -> None:
        if len(records) > CACHE_BYTES // 2:
            return
        with self._lock:
            self._chunks[start] = records
            while sum(map(len, self._chunks.values())) > CACHE_BYTES:
                self._chunks.popitem(last=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return _ChunkCache, ()


def _record_at(records: bytes | memoryview, offset: int, chunk: int) -> RawRecord:
    """The record at `offset` of an unpacked chunk."""
    if offset + RECORD_HEADER.size > len(records):
        raise broken("an index that leads out of its chunk", chunk)
    opcode, length = RECORD_HEADER.unpack_from(records, offset)
    body = memoryview(records)[offset + RECORD_HEADER.size :][:length]
    if len(body) < length:
        raise broken("an index that leads into the middle of a record", chunk)
    return RawRecord(opcode, chunk, body)
