"""The records of a recording that is damaged anywhere: what is sound, and the gaps between."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import FileIO

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from pseudolidar.errors import RecordingError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.records import (
    CHUNK_START,
    DATA_LENGTH,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    PackedChunk,
    RawRecord,
    parsed,
    read_record,
    record_bytes,
)

# Kinds of records with the parser of each; chunks and messages are looked at without a copy.
KINDS: dict[int, type[McapRecord]] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}
KNOWN = frozenset({*KINDS, Opcode.CHUNK, Opcode.MESSAGE})
# Opcodes from here on are private: to be skipped, says the specification.
PRIVATE = 0x80

COMPRESSIONS = (b"", b"lz4", b"zstd")
# A record's opcode and a length below 2^40, at any byte.
_HEAD = re.compile(rb"(?=[\x01-\x0f][\s\S]{5}\0\0\0)")
LONGEST_BYTES = 2**40
WINDOW_BYTES = 1 << 20
# Longest record that is read to tell whether it is one where a search comes by: a hostile file may
# have something like a head every nine bytes.
SEARCHED_BYTES = 1 << 16
# What tells by itself where it ends: a chunk's lengths, one within the other.
CHUNK_HEAD_BYTES = CHUNK_START.size + 4 + DATA_LENGTH.size


@dataclass(frozen=True)
class Gap:
    """Bytes that are no record.

    Args:
        offset: first of them.
        end: byte after the last.
        reason: what is wrong at the first.
    """

    offset: int
    end: int
    reason: str


@dataclass(frozen=True)
class EndMark:
    """The magic at the end of a whole file.

    Args:
        offset: where it begins.
    """

    offset: int


def surviving_records(
    file: FileIO, limits: Limits = DEFAULT_LIMITS
) -> Iterator[RawRecord | Gap | EndMark]:
    """Go through a file that may be damaged anywhere; every byte of it is in one of the results.

    A record that is not one is passed by where its length leads to another one, else by searching
    for the next: chunks, whose lengths must agree, attachments, metadata and what stands in the
    summary; single messages only in a file that has them outside of chunks (records within a
    chunk that is not compressed look the same).

    Args:
        file: open for reading.
        limits: caps on what it may claim.
    """
    return _Scan(file, limits).run()


class _Scan:
    """One pass over a file."""

    def __init__(self, file: FileIO, limits: Limits) -> None:
        self._file, self._limits = file, limits
        self._size = file.seek(0, os.SEEK_END)
        self._chunked = False

    def run(self) -> Iterator[RawRecord | Gap | EndMark]:
        """Everything in order."""
        offset = len(MAGIC) if self._bytes(0, len(MAGIC)) == MAGIC else 0
        if not offset:
            offset = self._next(0)
            yield Gap(0, offset, "it does not begin as an MCAP file")
        while offset < self._size:
            piece = self._piece(offset)
            yield piece
            offset = self._size if isinstance(piece, EndMark) else piece.end

    def _piece(self, offset: int) -> RawRecord | Gap | EndMark:
        if self._size - offset == len(MAGIC) and self._bytes(offset, len(MAGIC)) == MAGIC:
            return EndMark(offset)
        try:
            opcode, length = self._head(offset)
            end = offset + RECORD_HEADER.size + length
            if opcode not in KNOWN and opcode < PRIVATE:
                raise RecordingError(f"no record of kind {opcode}")
            record = read_record(self._file, offset, self._size, self._limits)
        except RecordingError as error:
            return Gap(offset, self._next(offset + 1), error.got)
        follows = self._follows(end)
        reason = _unsound(record)
        if not reason and (follows or _tells_its_length(record)):
            self._chunked |= opcode == Opcode.CHUNK
            return record
        reason = reason or "a record of a length that leads to no other"
        return Gap(offset, end if follows else self._next(offset + 1), reason)

    def _next(self, start: int) -> int:
        """Where the next record begins that can be believed, or the end of the file."""
        while start < self._size:
            window = self._bytes(start, WINDOW_BYTES + RECORD_HEADER.size)
            for match in _HEAD.finditer(window):
                if match.start() < WINDOW_BYTES and self._believable(start + match.start()):
                    return start + match.start()
            start += WINDOW_BYTES
        return self._size

    def _believable(self, offset: int) -> bool:
        try:
            opcode, length = self._head(offset)
        except RecordingError:
            return False
        body = offset + RECORD_HEADER.size
        if opcode == Opcode.CHUNK:
            return _chunk_lengths_agree(self._bytes(body, CHUNK_HEAD_BYTES), length)
        inside_chunks = (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL)
        if opcode not in KNOWN or (self._chunked and opcode in inside_chunks):
            return False
        if not self._follows(body + length):
            return False
        if length > SEARCHED_BYTES:
            return opcode in (Opcode.ATTACHMENT, Opcode.MESSAGE)
        return not _unsound(RawRecord(opcode, offset, self._bytes(body, length)))

    def _follows(self, offset: int) -> bool:
        """Whether a record can begin at `offset`, cut off or not, or the file ends there."""
        head = self._bytes(offset, RECORD_HEADER.size)
        if len(head) < RECORD_HEADER.size:
            return not head or MAGIC.startswith(head) or head[0] in KNOWN
        opcode, length = RECORD_HEADER.unpack(head)
        longest = self._size if opcode >= PRIVATE else LONGEST_BYTES
        return (opcode in KNOWN or opcode >= PRIVATE) and bool(length < longest)

    def _head(self, offset: int) -> tuple[int, int]:
        """Opcode and length at `offset`.

        Raises:
            RecordingError: the file ends before, or within the record.
        """
        head = self._bytes(offset, RECORD_HEADER.size)
        if len(head) < RECORD_HEADER.size:
            raise RecordingError(f"the file ends after {self._size} bytes, before its end mark")
        opcode, length = RECORD_HEADER.unpack(head)
        left = self._size - offset - RECORD_HEADER.size
        if length > left:
            raise RecordingError(f"a record that claims {length} bytes where {left} are left")
        return opcode, length

    def _bytes(self, offset: int, count: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(count)


def _chunk_lengths_agree(head: bytes, length: int) -> bool:
    if len(head) < CHUNK_START.size or length < CHUNK_START.size + DATA_LENGTH.size:
        return False
    name_bytes = CHUNK_START.unpack_from(head)[4]
    name_end = CHUNK_START.size + name_bytes
    if name_bytes > 4 or head[CHUNK_START.size : name_end] not in COMPRESSIONS:
        return False
    (data_bytes,) = DATA_LENGTH.unpack_from(head.ljust(CHUNK_HEAD_BYTES, b"\0"), name_end)
    return bool(name_end + DATA_LENGTH.size + data_bytes == length)


def _tells_its_length(record: RawRecord) -> bool:
    """Whether the fields of a sound record confirm its length; those of messages never do."""
    if record.opcode == Opcode.CHUNK:
        return True
    kind = KINDS.get(record.opcode)
    return kind is not None and len(record_bytes(parsed(kind, record))) == (
        RECORD_HEADER.size + len(record.body)
    )


def _unsound(record: RawRecord) -> str:
    """What is wrong with a record by itself; empty where nothing is."""
    if record.opcode >= PRIVATE:
        return ""
    try:
        if record.opcode == Opcode.CHUNK:
            PackedChunk.parse(record)
            if not _chunk_lengths_agree(bytes(record.body[:CHUNK_HEAD_BYTES]), len(record.body)):
                return "a chunk whose lengths do not agree"
        elif record.opcode == Opcode.MESSAGE:
            if len(record.body) < MESSAGE_HEADER.size:
                return "a message without its header"
        else:
            parsed(KINDS[record.opcode], record)
    except (RecordingError, struct.error, MemoryError) as error:
        return error.got if isinstance(error, RecordingError) else str(error)
    return ""
