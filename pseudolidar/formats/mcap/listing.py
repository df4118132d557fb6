"""What is in an MCAP file, by its summary and the indexes behind its chunks, or by a scan."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import FileIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import ChunkIndex, Footer, Header, Schema, Statistics

from pseudolidar.errors import RecordingError
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.mcap.records import (
    MAGIC,
    RECORD_HEADER,
    PackedChunk,
    RawRecord,
    broken,
    inner_records,
    parse_message,
    parsed,
    read_record,
    unpacked,
)
from pseudolidar.formats.recordings.message_store import LOST, Channel
from pseudolidar.structures.arrays import AnyArray

FOOTER_BYTES = RECORD_HEADER.size + 20
# Bytes of a footer record after its CRC field's beginning.
FOOTER_CRC_BYTES = 4
# Message index: channel, bytes of the entries; each entry is a time and a place in the chunk.
INDEX_START = struct.Struct("<HI")
INDEX_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])
# A message by where it is: the byte at which its chunk begins (`NO_CHUNK`: it is in none), and the
# byte of its record within the unpacked chunk, or in the file.
ENTRY = np.dtype([("time", "<i8"), ("chunk", "<i8"), ("offset", "<i8")])
NO_CHUNK = -1
LATCHED_TOPIC = "/tf_static"
LARGEST_TIME_NS = 2**63 - 1


def contents_of(file: FileIO, size: int, limits: Limits) -> McapContents:
    """Channels and messages of a file of `size` bytes, complete, cut or damaged.

    Raises:
        RecordingError: not one message in it, and it is damaged.
    """
    found = _indexed(file, size, limits)
    return _Scan(file, size, limits).contents(reason=found) if isinstance(found, str) else found


@dataclass(frozen=True, eq=False)
class McapContents:
    """What is in a file.

    Args:
        channels: those that have messages.
        entries: by channel, `ENTRY` of each message, by time.
        library: the program that wrote it.
        notes: what is lost.
    """

    channels: tuple[Channel, ...]
    entries: tuple[AnyArray, ...]
    library: str
    notes: tuple[str, ...]


class _Declared:
    """Schemas and channels as they are declared, and messages of each channel."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, ChannelRecord] = {}
        self.entries: dict[int, list[AnyArray]] = {}

    def add(self, record: RawRecord) -> None:
        if record.opcode == Opcode.SCHEMA:
            schema = parsed(Schema, record)
            self.schemas.setdefault(schema.id, schema)
        elif record.opcode == Opcode.CHANNEL:
            channel = parsed(ChannelRecord, record)
            self.channels.setdefault(channel.id, channel)

    def contents(self, library: str, notes: Sequence[str]) -> McapContents:
        """Channels that have messages, messages in the order of time."""
        channels, entries, lost = [], [], list(notes)
        for number, parts in sorted(self.entries.items()):
            own = np.concatenate(parts) if parts else np.empty(0, ENTRY)
            if not len(own):
                continue
            if number not in self.channels:
                lost.append(f"{LOST}{len(own)} messages of channel {number}, which is not declared")
                continue
            channels.append(self._channel(self.channels[number]))
            entries.append(own[np.argsort(own["time"], kind="stable")])
        return McapContents(tuple(channels), tuple(entries), library, tuple(lost))

    def _channel(self, record: ChannelRecord) -> Channel:
        schema = self.schemas.get(record.schema_id)
        durable = "durability: 1" in record.metadata.get("offered_qos_profiles", "")
        return Channel(
            topic=record.topic,
            schema=schema.name if schema else "",
            definition=schema.data if schema else b"",
            definition_encoding=schema.encoding if schema else "",
            encoding=record.message_encoding,
            latched=durable or record.topic == LATCHED_TOPIC,
        )


def _indexed(file: FileIO, size: int, limits: Limits) -> McapContents | str:
    """What the summary and its indexes say, or why they do not."""
    try:
        start = _summary_start(file, size, limits)
        if start == 0:
            return "it has no summary"
        declared, chunks, statistics = _summary(file, start, size, limits)
        if statistics is None or len(chunks) != statistics.chunk_count:
            return "its summary does not count what there is"
        if sum(chunk.message_index_length for chunk in chunks) > size:
            return "its index claims more bytes than there are"
        for chunk in chunks:
            _read_index(file, chunk, declared)
        counted = sum(len(part) for parts in declared.entries.values() for part in parts)
        if counted != statistics.message_count:
            return f"its index has {counted} of {statistics.message_count} messages"
        return declared.contents(_library(file, size, limits), ())
    except RecordingError as error:
        return f"{error.got} ({error.where})"


def _summary_start(file: FileIO, size: int, limits: Limits) -> int:
    """Byte at which the summary begins, 0 where there is none.

    Raises:
        RecordingError: the file does not end as complete ones do.
    """
    at = size - len(MAGIC) - FOOTER_BYTES
    if at < len(MAGIC):
        raise broken(f"the file ends after {size} bytes", size)
    file.seek(size - len(MAGIC))
    if file.read(len(MAGIC)) != MAGIC:
        raise broken("no end mark: the file is cut, or was never closed", size)
    record = read_record(file, at, size, limits)
    if record.opcode != Opcode.FOOTER:
        raise broken("no footer before the end mark", at)
    footer = parsed(Footer, record)
    if not 0 < footer.summary_start < at:
        return 0
    file.seek(footer.summary_start)
    if at - footer.summary_start > limits.record_bytes:
        raise broken(f"a summary of {at - footer.summary_start} bytes", at)
    crc = crc32(file.read(at - footer.summary_start))
    crc = crc32(record.body[:-FOOTER_CRC_BYTES], crc32(record.header(), crc))
    if footer.summary_crc not in (0, crc):
        raise broken("a summary whose CRC does not match", footer.summary_start)
    return int(footer.summary_start)


def _summary(
    file: FileIO, start: int, size: int, limits: Limits
) -> tuple[_Declared, list[ChunkIndex], Statistics | None]:
    declared, chunks = _Declared(), list[ChunkIndex]()
    statistics: Statistics | None = None
    offset = start
    while True:
        record = read_record(file, offset, size, limits)
        offset = record.end
        if record.opcode == Opcode.FOOTER:
            return declared, chunks, statistics
        if record.opcode == Opcode.CHUNK_INDEX:
            chunks.append(parsed(ChunkIndex, record))
        elif record.opcode == Opcode.STATISTICS:
            statistics = parsed(Statistics, record)
        else:
            declared.add(record)


def _read_index(file: FileIO, chunk: ChunkIndex, declared: _Declared) -> None:
    """The message index records behind a chunk."""
    at = chunk.chunk_start_offset + chunk.chunk_length
    file.seek(at)
    data = file.read(chunk.message_index_length)
    if len(data) < chunk.message_index_length:
        raise broken("an index behind the end of the file", at)
    for record in inner_records(data, at):
        if record.opcode == Opcode.MESSAGE_INDEX:
            _add_index(record, chunk.chunk_start_offset, declared)


def _add_index(record: RawRecord, chunk_start: int, declared: _Declared) -> None:
    if len(record.body) < INDEX_START.size:
        raise broken("an index of messages without its header", chunk_start)
    number, nbytes = INDEX_START.unpack_from(record.body)
    body = memoryview(record.body)[INDEX_START.size :]
    if nbytes != len(body) or nbytes % INDEX_ENTRY.itemsize:
        raise broken(f"an index of messages of {len(body)} bytes", chunk_start)
    found = np.frombuffer(body, INDEX_ENTRY)
    entries = np.empty(len(found), ENTRY)
    entries["time"] = np.minimum(found["time"], LARGEST_TIME_NS)
    entries["chunk"] = chunk_start
    entries["offset"] = np.minimum(found["offset"], LARGEST_TIME_NS)
    declared.entries.setdefault(number, []).append(entries)


def _library(file: FileIO, size: int, limits: Limits) -> str:
    record = read_record(file, len(MAGIC), size, limits)
    return str(parsed(Header, record).library) if record.opcode == Opcode.HEADER else ""


class _Scan:
    """One pass over all records of a file that has no usable index."""

    def __init__(self, file: FileIO, size: int, limits: Limits) -> None:
        self._file, self._size, self._limits = file, size, limits
        self._declared = _Declared()
        self._library = ""
        self._rows: dict[int, list[tuple[int, int, int]]] = {}
        self._lost_chunks: list[RecordingError] = []
        self._lost_messages = 0
        # Whether the index records that follow belong to a chunk that was lost.
        self._after_lost = False

    def contents(self, *, reason: str) -> McapContents:
        """Everything up to the first record that cannot be told from the next."""
        end: RecordingError | None = None
        offset = len(MAGIC)
        try:
            while offset < self._size:
                record = read_record(self._file, offset, self._size, self._limits)
                if record.opcode in (Opcode.DATA_END, Opcode.FOOTER):
                    break
                self._add(record)
                offset = record.end
        except RecordingError as error:
            end = error
        self._flush()
        found = self._declared.contents(self._library, ())
        if not found.channels and (end or self._lost_chunks):
            raise end or self._lost_chunks[0]
        return McapContents(
            found.channels,
            found.entries,
            found.library,
            (f"read without its index: {reason}", *self._losses(offset, end), *found.notes),
        )

    def _losses(self, offset: int, end: RecordingError | None) -> Iterator[str]:
        kept = sum(len(part) for parts in self._declared.entries.values() for part in parts)
        if self._lost_chunks:
            first = self._lost_chunks[0]
            yield (
                f"{LOST}{len(self._lost_chunks)} damaged chunks with {self._lost_messages or '?'} "
                f"messages, the first at {first.where} ({first.got}); {kept} messages are left"
            )
        if end is not None:
            yield (
                f"{LOST}the last {self._size - offset} bytes, from byte {offset} on ({end.got}); "
                f"{kept} messages are left"
            )

    def _add(self, record: RawRecord) -> None:
        if record.opcode == Opcode.CHUNK:
            self._flush()
            self._after_lost = False
            try:
                chunk = PackedChunk.parse(record)
                for inner in inner_records(
                    unpacked(chunk, record.offset, self._limits), record.offset
                ):
                    self._inner(inner, record.offset, inner.offset)
            except RecordingError as error:
                self._rows.clear()
                self._lost_chunks.append(error)
                self._after_lost = True
        elif record.opcode == Opcode.MESSAGE_INDEX:
            if self._after_lost and len(record.body) >= INDEX_START.size:
                nbytes = INDEX_START.unpack_from(record.body)[1]
                self._lost_messages += min(nbytes, len(record.body)) // INDEX_ENTRY.itemsize
        elif record.opcode == Opcode.HEADER:
            self._library = str(parsed(Header, record).library)
        else:
            self._inner(record, NO_CHUNK, record.offset)

    def _inner(self, record: RawRecord, chunk: int, offset: int) -> None:
        if record.opcode == Opcode.MESSAGE:
            message = parse_message(record)
            time_ns = min(message.log_time_ns, LARGEST_TIME_NS)
            self._rows.setdefault(message.channel_id, []).append((time_ns, chunk, offset))
        else:
            self._declared.add(record)

    def _flush(self) -> None:
        for number, rows in self._rows.items():
            self._declared.entries.setdefault(number, []).append(np.array(rows, ENTRY))
        self._rows.clear()
