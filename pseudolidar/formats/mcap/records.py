"""Records of an MCAP file, read with every length checked before it is believed.

Source: MCAP File Format Specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import FileIO
from typing import Self, TypeAlias, TypeVar, cast

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import McapRecord

from pseudolidar.errors import RecordingError
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.formats.mcap.compression import decompressed

MAGIC = b"\x89MCAP0\r\n"
# A serialised message in pieces; their concatenation is the message.
Parts: TypeAlias = tuple[bytes | memoryview, ...]
AnyRecord = TypeVar("AnyRecord", bound=McapRecord)

# Every record: opcode, length of what follows.
RECORD_HEADER = struct.Struct("<BQ")
# Message: channel, sequence, log time, publish time; then its data.
MESSAGE_HEADER = struct.Struct("<HIQQ")
# Chunk: start, end, unpacked size, its CRC, length of the compression's name; then the name, the
# length of the data and the data.
CHUNK_START = struct.Struct("<QQQII")
DATA_LENGTH = struct.Struct("<Q")


@dataclass(frozen=True)
class RawRecord:
    """A record as it stands in the file.

    Args:
        opcode: its kind.
        offset: byte in the file, or in the unpacked chunk, where its header begins.
        body: what follows the header.
    """

    opcode: int
    offset: int
    body: bytes | memoryview

    @property
    def end(self) -> int:
        """Byte after it."""
        return self.offset + RECORD_HEADER.size + len(self.body)

    def header(self) -> bytes:
        """Its header, as it stands in the file."""
        return RECORD_HEADER.pack(self.opcode, len(self.body))


@dataclass(frozen=True)
class PackedChunk:
    """A chunk record; unlike that of `mcap.records` it is read and written without copies.

    Args:
        start_ns: earliest time of its messages.
        end_ns: latest time of its messages.
        unpacked_bytes: size of its records.
        unpacked_crc: CRC of its records, 0 for none.
        compression: as the file names it.
        packed: its records, compressed.
    """

    start_ns: int
    end_ns: int
    unpacked_bytes: int
    unpacked_crc: int
    compression: str
    packed: bytes | memoryview

    @classmethod
    def parse(cls, record: RawRecord) -> Self:
        """The chunk of a chunk record.

        Raises:
            RecordingError: it is cut.
        """
        try:
            start, end, size, crc, name_bytes = CHUNK_START.unpack_from(record.body)
            name_end = CHUNK_START.size + name_bytes
            name = bytes(record.body[CHUNK_START.size : name_end]).decode()
            (packed_bytes,) = DATA_LENGTH.unpack_from(record.body, name_end)
        except (struct.error, UnicodeDecodeError) as error:
            raise broken("a chunk without its header", record.offset) from error
        packed = memoryview(record.body)[name_end + DATA_LENGTH.size :][:packed_bytes]
        if len(packed) < packed_bytes:
            raise broken("a chunk that ends within its data", record.offset)
        return cls(start, end, size, crc, name, packed)

    def head(self) -> bytes:
        """The record up to its packed records."""
        name = self.compression.encode()
        start = CHUNK_START.pack(
            self.start_ns, self.end_ns, self.unpacked_bytes, self.unpacked_crc, len(name)
        )
        head = start + name + DATA_LENGTH.pack(len(self.packed))
        return RECORD_HEADER.pack(Opcode.CHUNK, len(head) + len(self.packed)) + head


@dataclass(frozen=True)
class RawMessage:
    """A message within a chunk.

    Args:
        channel_id: its channel.
        sequence: counter of its publisher.
        log_time_ns: time it is filed under.
        offset: of its record in the unpacked chunk.
        data: serialised message.
    """

    channel_id: int
    sequence: int
    log_time_ns: int
    offset: int
    data: memoryview


def read_record(file: FileIO, offset: int, size: int, limits: Limits = DEFAULT_LIMITS) -> RawRecord:
    """The record at `offset` of a file of `size` bytes.

    Raises:
        RecordingError: the file ends within it, or it claims more than the cap.
    """
    opcode, length = record_head(file, offset, size, limits)
    body = file.read(length)
    if len(body) < length:
        raise broken(f"a record of which {len(body)} of {length} bytes can be read", offset)
    return RawRecord(opcode, offset, body)


def record_head(
    file: FileIO, offset: int, size: int, limits: Limits = DEFAULT_LIMITS
) -> tuple[int, int]:
    """Opcode and length of the record at `offset`; the file then stands at its body.

    Raises:
        RecordingError: the file ends within it, or it claims more than the cap.
    """
    file.seek(offset)
    header = file.read(RECORD_HEADER.size)
    if len(header) < RECORD_HEADER.size:
        raise broken(f"the file ends after {size} bytes, before its end mark", offset)
    opcode, length = RECORD_HEADER.unpack(header)
    left = size - offset - RECORD_HEADER.size
    if length > left:
        raise broken(f"a record that claims {length} bytes where {left} are left", offset)
    if length > limits.record_bytes:
        raise RecordingError(
            f"a record of {length} bytes",
            want=f"at most {limits.record_bytes}",
            fix=raise_cap("record_bytes"),
            where=f"byte {offset}",
        )
    return opcode, length


def parsed(kind: type[AnyRecord], record: RawRecord) -> AnyRecord:
    """The fields of a record, read by the parser of its kind in `mcap.records`.

    Raises:
        RecordingError: they do not fit into it.
    """
    try:
        return cast("AnyRecord", kind.read(ReadDataStream(io.BytesIO(record.body))))  # type: ignore[attr-defined]
    except (McapError, struct.error, UnicodeDecodeError, OverflowError) as error:
        raise broken(f"a {kind.__name__} record that cannot be read", record.offset) from error


def unpacked(
    chunk: PackedChunk, offset: int, limits: Limits = DEFAULT_LIMITS
) -> bytes | memoryview:
    """The records of a chunk, unpacked to no more than they claim, their CRC checked.

    Args:
        chunk: the chunk.
        offset: byte in the file where it begins, for errors.
        limits: caps.

    Raises:
        RecordingError: damaged, or larger than the caps.
    """
    size, packed = chunk.unpacked_bytes, len(chunk.packed)
    allowed = limits.allowed_unpacked(packed)
    if size > allowed:
        raise RecordingError(
            f"a chunk of {packed} bytes that claims to unpack to {size}",
            want=f"at most {allowed}",
            fix=raise_cap("chunk_bytes"),
            where=f"byte {offset}",
        )
    try:
        data = decompressed(chunk.packed, chunk.compression, size)
    except ValueError as error:
        raise broken(f"a chunk that cannot be unpacked: {error}", offset) from error
    if chunk.unpacked_crc not in (0, crc32(data)):
        raise broken("a chunk whose CRC does not match", offset)
    return data


def inner_records(
    data: bytes | memoryview, offset: int, limits: Limits = DEFAULT_LIMITS
) -> Iterator[RawRecord]:
    """The records within an unpacked chunk that begins at byte `offset` of the file.

    Raises:
        RecordingError: they do not fill it exactly, or are more than the cap.
    """
    at, view, left = 0, memoryview(data), limits.chunk_records
    while at < len(data):
        body = at + RECORD_HEADER.size
        length = RECORD_HEADER.unpack_from(data, at)[1] if body <= len(data) else 0
        if body + length > len(data):
            raise broken("a chunk that ends within a record", offset)
        if not left:
            raise RecordingError(
                f"a chunk of more than {limits.chunk_records} records",
                want="fewer",
                fix=raise_cap("chunk_records"),
                where=f"byte {offset}",
            )
        left -= 1
        yield RawRecord(data[at], at, view[body : body + length])
        at = body + length


def parse_message(record: RawRecord) -> RawMessage:
    """The message of a message record.

    Raises:
        RecordingError: too short to be one.
    """
    if len(record.body) < MESSAGE_HEADER.size:
        raise broken("a message without its header", record.offset)
    channel_id, sequence, log_time_ns, _ = MESSAGE_HEADER.unpack_from(record.body)
    data = memoryview(record.body)[MESSAGE_HEADER.size :]
    return RawMessage(channel_id, sequence, log_time_ns, record.offset, data)


def record_bytes(record: McapRecord) -> bytes:
    """A record as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def broken(got: str, offset: int) -> RecordingError:
    """The error of a damaged recording."""
    return RecordingError(
        got,
        want="an undamaged recording",
        fix="Write it again, or copy it again.",
        where=f"byte {offset}",
    )
