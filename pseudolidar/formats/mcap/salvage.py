"""Everything that can be saved of a damaged recording, message by message, and what cannot."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from io import FileIO

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    DataEnd,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    Schema,
    Statistics,
)

from pseudolidar.errors import RecordingError
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.compression import leading_bytes
from pseudolidar.formats.mcap.records import (
    CHUNK_START,
    DATA_LENGTH,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    PackedChunk,
    RawRecord,
    inner_records,
    parsed,
    unpacked,
)
from pseudolidar.formats.mcap.saved import Declared, Loss, Saved, SavedMessage
from pseudolidar.formats.mcap.scan import EndMark, Gap, surviving_records

# What a chunk holds.
IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
# The last field of an attachment, and of a footer.
CRC_BYTES = 4
DATA_CRC = struct.Struct("<I")


class Salvage:
    """One pass over a file that may be damaged anywhere.

    Args:
        file: open for reading.
        known: channels that another pass has found; for messages that stand before, or without,
            the declaration of theirs.
        keep_damaged: of chunks that fail their CRC or do not unpack, save the whole messages up to
            the first that is none; nothing tells whether those are as they were. Of a chunk that
            the end of the file cuts off they are always saved.
        limits: caps on what the file may claim.
    """

    def __init__(
        self,
        file: FileIO,
        *,
        known: Declared | None = None,
        keep_damaged: bool = False,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self._file, self._known, self._limits = file, known or Declared(), limits
        self._keep_damaged = keep_damaged
        self.declared = Declared()
        # Messages by topic that the summary claims; None where it is lost.
        self.claimed: dict[str, int] | None = None
        self.compression: str | None = None
        self.position = 0
        self._crc, self._footer = crc32(MAGIC), False
        self._lost_chunk: RawRecord | None = None
        self._lost_reason = ""
        self._lost_counts: Counter[int] | None = None
        self._claimed_by_id: dict[int, int] | None = None

    def run(self) -> Iterator[Saved]:
        """Everything in the order of the file; also what is wrong without costing a message."""
        ended = False
        for piece in surviving_records(self._file, self._limits):
            match piece:
                case EndMark():
                    ended = self._footer
                    self.position = piece.offset
                case Gap():
                    yield from self._finish_chunk()
                    self.position = piece.end
                    yield from self._gap(piece)
                case RawRecord():
                    self.position = piece.end
                    yield from self._record(piece)
        yield from self._finish_chunk()
        if self._claimed_by_id is not None:
            topics: Counter[str] = Counter()
            for number, count in self._claimed_by_id.items():
                channel = self._channel(number)
                topics[channel.topic if channel else f"channel {number}"] += count
            self.claimed = dict(topics)
        if not ended:
            yield Loss(self.position, 0, "no end: the index of the file is missing")

    def _record(self, record: RawRecord) -> Iterator[Saved]:
        if record.opcode not in (Opcode.MESSAGE_INDEX, Opcode.CHUNK):
            yield from self._finish_chunk()
        if record.opcode == Opcode.DATA_END:
            yield from self._data_end(record)
            self._crc = 0
        elif record.opcode == Opcode.FOOTER:
            yield from self._footer_crc(record)
        else:
            self._crc = crc32(record.body, crc32(record.header(), self._crc))
        match record.opcode:
            case Opcode.HEADER:
                yield parsed(Header, record)
            case Opcode.CHUNK:
                yield from self._finish_chunk()
                yield from self._chunk(record)
            case Opcode.MESSAGE_INDEX:
                if self._lost_chunk is not None:
                    index = parsed(MessageIndex, record)
                    counts = self._lost_counts or Counter[int]()
                    counts[index.channel_id] += len(index.records)
                    self._lost_counts = counts
            case Opcode.SCHEMA | Opcode.CHANNEL | Opcode.MESSAGE:
                yield from self._inner(record, record.offset)
            case Opcode.ATTACHMENT:
                yield self._attachment(record)
            case Opcode.METADATA:
                yield parsed(Metadata, record)
            case Opcode.STATISTICS:
                self._claimed_by_id = dict(parsed(Statistics, record).channel_message_counts)
            case Opcode.FOOTER:
                self._footer = True

    def _data_end(self, record: RawRecord) -> Iterator[Loss]:
        """Of data without chunks nothing else tells whether bytes have changed."""
        expected = parsed(DataEnd, record).data_section_crc
        if expected not in (0, self._crc):
            yield Loss(record.offset, 0, "data whose CRC does not match")

    def _footer_crc(self, record: RawRecord) -> Iterator[Loss]:
        expected = parsed(Footer, record).summary_crc
        found = crc32(record.body[:-CRC_BYTES], crc32(record.header(), self._crc))
        if expected not in (0, found):
            yield Loss(record.offset, 0, "an index whose CRC does not match")

    def _inner(self, record: RawRecord, offset: int) -> Iterator[Saved]:
        """A declaration or a message, in a chunk or outside."""
        match record.opcode:
            case Opcode.SCHEMA:
                schema = parsed(Schema, record)
                self.declared.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = parsed(Channel, record)
                self.declared.channels[channel.id] = channel
            case Opcode.MESSAGE:
                yield self._message(record, offset)

    def _message(self, record: RawRecord, offset: int) -> SavedMessage | Loss:
        number, sequence, log_time, publish_time = MESSAGE_HEADER.unpack_from(record.body)
        channel = self._channel(number)
        size = RECORD_HEADER.size + len(record.body)
        if channel is None:
            counts = {f"channel {number}": 1}
            return Loss(offset, size, f"a message on undeclared channel {number}", counts)
        schemas = self.declared.schemas, self._known.schemas
        schema = next((s[channel.schema_id] for s in schemas if channel.schema_id in s), None)
        data = memoryview(record.body)[MESSAGE_HEADER.size :]
        return SavedMessage(channel, schema, sequence, log_time, publish_time, data)

    def _channel(self, number: int) -> Channel | None:
        return self.declared.channels.get(number) or self._known.channels.get(number)

    def _chunk(self, record: RawRecord) -> Iterator[Saved]:
        chunk = PackedChunk.parse(record)
        self.compression = self.compression or chunk.compression or "none"
        try:
            data = unpacked(chunk, record.offset, self._limits)
        except RecordingError as error:
            self._lost_chunk, self._lost_reason = record, error.got
            if self._keep_damaged:
                yield from self._leading(chunk, record.offset)
            return
        try:
            for inner in inner_records(data, record.offset, self._limits):
                yield from self._inner(inner, record.offset)
        except RecordingError as error:
            self._lost_chunk, self._lost_reason = record, error.got

    def _finish_chunk(self) -> Iterator[Loss]:
        """What was in a damaged chunk, as the indexes after it tell."""
        lost, self._lost_chunk = self._lost_chunk, None
        counts, self._lost_counts = self._lost_counts, None
        if lost is None:
            return
        topics = None if counts is None else self._by_topic(counts)
        nbytes = RECORD_HEADER.size + len(lost.body)
        yield Loss(lost.offset, nbytes, self._lost_reason, topics)

    def _by_topic(self, counts: Mapping[int, int]) -> dict[str, int]:
        topics: Counter[str] = Counter()
        for number, count in counts.items():
            channel = self._channel(number)
            topics[channel.topic if channel else f"channel {number}"] += count
        return dict(topics)

    def _gap(self, gap: Gap) -> Iterator[Saved]:
        size = self._file.seek(0, 2)
        if gap.end == size:
            yield from self._cut_chunk(gap)
        yield Loss(gap.offset, gap.end - gap.offset, gap.reason)

    def _cut_chunk(self, gap: Gap) -> Iterator[Saved]:
        """Whole messages of a chunk that the end of the file cuts off."""
        self._file.seek(gap.offset)
        head = self._file.read(RECORD_HEADER.size)
        if len(head) < RECORD_HEADER.size or head[0] != Opcode.CHUNK:
            return
        body = self._file.read(min(gap.end - gap.offset, self._limits.record_bytes))
        if len(body) < CHUNK_START.size:
            return
        start, end, size, crc, name_bytes = CHUNK_START.unpack_from(body)
        name_end = CHUNK_START.size + name_bytes
        name = body[CHUNK_START.size : name_end]
        packed = memoryview(body)[name_end + DATA_LENGTH.size :]
        if name in (b"", b"lz4", b"zstd"):
            chunk = PackedChunk(start, end, size, crc, name.decode(), packed)
            yield from self._leading(chunk, gap.offset)

    def _leading(self, chunk: PackedChunk, offset: int) -> Iterator[Saved]:
        """Whole records of a chunk up to the first that is none."""
        most = min(chunk.unpacked_bytes, self._limits.allowed_unpacked(len(chunk.packed)))
        data = leading_bytes(chunk.packed, chunk.compression, most)
        try:
            for record in inner_records(data, offset, self._limits):
                if record.opcode not in IN_CHUNKS:
                    return
                if record.opcode == Opcode.MESSAGE and len(record.body) < MESSAGE_HEADER.size:
                    return
                for saved in self._inner(record, offset):
                    if isinstance(saved, SavedMessage):
                        saved = replace(saved, damaged=True)
                    yield saved
        except RecordingError:
            return

    def _attachment(self, record: RawRecord) -> Attachment | Loss:
        attachment = parsed(Attachment, record)
        (crc,) = DATA_CRC.unpack_from(record.body, len(record.body) - CRC_BYTES)
        if crc not in (0, crc32(memoryview(record.body)[:-CRC_BYTES])):
            nbytes = RECORD_HEADER.size + len(record.body)
            return Loss(record.offset, nbytes, f"attachment {attachment.name!r} of another CRC")
        return attachment
