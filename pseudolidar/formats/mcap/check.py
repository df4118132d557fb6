"""Reads a recording back and checks that others can use it."""

from __future__ import annotations

import array
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import TypeAlias

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    MessageIndex,
    Schema,
    Statistics,
)

from pseudolidar.errors import PseudolidarError, RecordingError
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.channels import FRAME
from pseudolidar.formats.mcap.check_messages import ChannelCheck, MessageChecks
from pseudolidar.formats.mcap.facts import Fact
from pseudolidar.formats.mcap.facts_foxglove import foxglove_facts, message_class
from pseudolidar.formats.mcap.protobuf import PROTOBUF
from pseudolidar.formats.mcap.records import (
    MAGIC,
    RECORD_HEADER,
    PackedChunk,
    RawMessage,
    RawRecord,
    broken,
    inner_records,
    parse_message,
    parsed,
    read_record,
    record_head,
    unpacked,
)

# Bytes of a footer record after its CRC field's beginning.
FOOTER_CRC_BYTES = 4
# Time of the first message: what a chunk begins with.
START_BYTES = 8
# Encoding of messages by that of their schema.
ENCODINGS = {PROTOBUF: PROTOBUF, "ros2msg": "cdr"}
NO_SCHEMA = Schema(id=0, name="", encoding="", data=b"")

Reader: TypeAlias = Callable[[bytes], Iterable[Fact]]


@dataclass(frozen=True)
class McapSummary:
    """What a recording that passed its check holds.

    Args:
        frames: marked frames.
        messages: messages by topic.
        skipped: topics whose messages cannot be read here (other encodings); only counted.
        start_ns: first time stamp, 0 without messages.
        end_ns: last time stamp, 0 without messages.
        size_bytes: of the file.
    """

    frames: int
    messages: Mapping[str, int]
    skipped: tuple[str, ...]
    start_ns: int
    end_ns: int
    size_bytes: int


def check_mcap(path: Path, *, every: int = 1, limits: Limits = DEFAULT_LIMITS) -> McapSummary:
    """Read a recording from the first byte to the last and check it.

    Checked are: all CRCs, the summary against what is there, time stamps (positive, not
    decreasing on a topic), schemas (complete), transforms (one tree that has every frame in use,
    unit quaternions), and the messages: typed fields and whole points in clouds, sizes of raw
    images, beginnings and ends of encoded ones.

    Args:
        path: a complete recording.
        every: read the chunks of each n-th moment only (our frames are several chunks of one
            time); of the others place and length are checked, and their messages are counted by
            their index. With 1 every byte of the file is.
        limits: caps on what it may claim.

    Raises:
        RecordingError: says what is wrong, at which byte or in which message.
    """
    try:
        with FileIO(path, "rb") as file:
            return _Reading(file, every, limits).run()
    except FileNotFoundError:
        raise RecordingError("no such file", want="an MCAP recording", path=path) from None
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


class _Reading:
    """One pass over a file."""

    def __init__(self, file: FileIO, every: int, limits: Limits) -> None:
        self._file, self._every, self._limits = file, every, limits
        self._size = file.seek(0, os.SEEK_END)
        self._schemas: dict[int, tuple[Schema, Reader | None]] = {}
        self._channels: dict[int, ChannelCheck] = {}
        self._counts: Counter[int] = Counter()
        self._messages = MessageChecks()
        # Begin and length of each chunk, to compare with the index.
        self._chunks = array.array("Q")
        self._moment, self._moments = b"", 0
        self._unpack = True

    def run(self) -> McapSummary:
        """Check everything."""
        summary_start = self._data_section()
        self._summary_section(summary_start)
        self._messages.finish()
        topics: Counter[str] = Counter()
        for number, count in self._counts.items():
            topics[self._channels[number].topic] += count
        return McapSummary(
            frames=topics[FRAME],
            messages=dict(sorted(topics.items())),
            skipped=tuple(sorted(c.topic for c in self._channels.values() if c.facts is None)),
            start_ns=self._messages.start_ns,
            end_ns=self._messages.end_ns,
            size_bytes=self._size,
        )

    def _data_section(self) -> int:
        """Read up to the end of the data; returns where the summary begins."""
        self._file.seek(0)
        if self._file.read(len(MAGIC)) != MAGIC:
            raise broken("no MCAP file: it begins otherwise", 0)
        offset, crc = len(MAGIC), crc32(MAGIC)
        while True:
            opcode, length = record_head(self._file, offset, self._size, self._limits)
            if opcode == Opcode.CHUNK:
                self._unpack = self._is_wanted()
                self._chunks.extend((offset, RECORD_HEADER.size + length))
                if not self._unpack:
                    offset += RECORD_HEADER.size + length
                    continue
            record = read_record(self._file, offset, self._size, self._limits)
            offset = record.end
            if record.opcode == Opcode.DATA_END:
                expected = parsed(DataEnd, record).data_section_crc
                if self._every == 1 and expected not in (0, crc):
                    raise broken("data whose CRC does not match", record.offset)
                return offset
            crc = crc32(record.body, crc32(record.header(), crc))
            self._data_record(record)

    def _is_wanted(self) -> bool:
        """Whether the chunk that the file stands at is to be read."""
        moment = self._file.read(START_BYTES)
        if moment != self._moment:
            self._moment = moment
            self._moments += 1
        return (self._moments - 1) % self._every == 0

    def _data_record(self, record: RawRecord) -> None:
        if record.opcode == Opcode.CHUNK:
            self._chunk(PackedChunk.parse(record), record.offset)
        elif record.opcode == Opcode.MESSAGE_INDEX and not self._unpack:
            index = parsed(MessageIndex, record)
            self._counts[index.channel_id] += len(index.records)
        else:
            self._declaration_or_message(record, record.offset)

    def _chunk(self, chunk: PackedChunk, offset: int) -> None:
        for record in inner_records(unpacked(chunk, offset, self._limits), offset):
            self._declaration_or_message(record, offset)

    def _declaration_or_message(self, record: RawRecord, offset: int) -> None:
        if record.opcode == Opcode.SCHEMA:
            self._add_schema(parsed(Schema, record), offset)
        elif record.opcode == Opcode.CHANNEL:
            self._add_channel(parsed(Channel, record), offset)
        elif record.opcode == Opcode.MESSAGE:
            self._add_message(parse_message(record), offset)

    def _add_schema(self, schema: Schema, offset: int) -> None:
        if schema.id not in self._schemas:
            self._schemas[schema.id] = schema, _reader(schema, offset)

    def _add_channel(self, channel: Channel, offset: int) -> None:
        if channel.id in self._channels:
            return
        encoding = channel.message_encoding
        if channel.schema_id not in self._schemas and (encoding == PROTOBUF or channel.schema_id):
            raise broken(f"topic {channel.topic!r} without a schema", offset)
        schema, reader = self._schemas.get(channel.schema_id, (NO_SCHEMA, None))
        readable = encoding == ENCODINGS.get(schema.encoding)
        facts = reader if readable else None
        self._channels[channel.id] = ChannelCheck(channel.topic, schema.name, facts)

    def _add_message(self, message: RawMessage, offset: int) -> None:
        channel = self._channels.get(message.channel_id)
        if channel is None:
            raise broken(f"a message on undeclared channel {message.channel_id}", offset)
        self._counts[message.channel_id] += 1
        self._messages.check(channel, message)

    def _summary_section(self, start: int) -> None:
        """Compare summary, statistics and chunk index with what the data section holds."""
        statistics: Statistics | None = None
        indexed = array.array("Q")
        offset, crc = start, 0
        while True:
            record = read_record(self._file, offset, self._size, self._limits)
            offset = record.end
            if record.opcode == Opcode.FOOTER:
                break
            crc = crc32(record.body, crc32(record.header(), crc))
            if record.opcode == Opcode.STATISTICS:
                statistics = parsed(Statistics, record)
            elif record.opcode == Opcode.CHUNK_INDEX:
                index = parsed(ChunkIndex, record)
                indexed.extend((index.chunk_start_offset, index.chunk_length))
        self._footer(record, crc)
        if offset + len(MAGIC) != self._size or self._file.read(len(MAGIC)) != MAGIC:
            raise broken("no end mark after the summary", offset)
        if statistics and statistics.channel_message_counts != dict(self._counts):
            raise broken("statistics that count other messages than there are", start)
        if len(indexed) and indexed != self._chunks:
            raise broken("an index of other chunks than there are", start)

    def _footer(self, record: RawRecord, crc: int) -> None:
        crc = crc32(record.body[:-FOOTER_CRC_BYTES], crc32(record.header(), crc))
        if parsed(Footer, record).summary_crc not in (0, crc):
            raise broken("a summary whose CRC does not match", record.offset)


def _reader(schema: Schema, offset: int) -> Reader | None:
    """What tells the facts of messages of a schema; None where they cannot be read here."""
    if schema.encoding == PROTOBUF:
        kind = message_class(schema, offset)
        return lambda data: foxglove_facts(schema.name, kind.FromString(data))
    if schema.encoding == "ros2msg":
        from pseudolidar.formats.mcap.facts_ros2 import ros2_decoder, ros2_facts

        decode = ros2_decoder(schema)
        return decode and (lambda data: ros2_facts(schema.name, decode(data)))
    return None
