"""One frame of a recording as bytes: a chunk that depends on no other frame.

Workers pack their frames; whoever writes the file only appends. Each chunk declares the topics it
uses, so that its bytes are the same wherever it stands, and it can be read after any damage
elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import DecodeError
from mcap.opcode import Opcode
from mcap.records import MessageIndex

from pseudolidar.errors import StructureError
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.mcap_channels import (
    FRAME,
    channel_id,
    channel_record,
    schema_id,
    schema_record,
)
from pseudolidar.formats.mcap_compression import compressed
from pseudolidar.formats.mcap_content import Compression
from pseudolidar.formats.mcap_records import (
    MESSAGE_HEADER,
    RECORD_HEADER,
    PackedChunk,
    RawMessage,
    broken,
    inner_records,
    parse_message,
    record_bytes,
)

if TYPE_CHECKING:
    from pseudolidar.formats.mcap_messages import LogMessage

# Values of a message's sequence number.
SEQUENCES = 2**32


@dataclass(frozen=True, eq=False)
class FrameChunk:
    """A frame, ready to be appended to a recording.

    Args:
        frame_id: the source's name of the frame.
        head: the chunk record up to its packed records.
        packed: its packed records.
        index: the message index records that follow the chunk.
        index_offsets: where in `index` each channel's record begins, by channel.
        counts: messages by channel.
        start_ns: earliest time stamp.
        end_ns: latest time stamp.
        compression: as the file names it.
        unpacked_bytes: size of the records.
    """

    frame_id: str
    head: bytes
    packed: bytes | memoryview
    index: bytes
    index_offsets: Mapping[int, int]
    counts: Mapping[int, int]
    start_ns: int
    end_ns: int
    compression: str
    unpacked_bytes: int

    @property
    def nbytes(self) -> int:
        """Bytes that it adds to the file, besides some 200 in the summary."""
        return self.chunk_bytes + len(self.index)

    @property
    def chunk_bytes(self) -> int:
        """Length of the chunk record."""
        return len(self.head) + len(self.packed)


def pack_frame(
    messages: Iterable[LogMessage], *, index: int, compression: Compression = "lz4"
) -> FrameChunk:
    """Pack the messages of one frame; pure, for worker threads.

    Args:
        messages: of one frame, the mark of the frame among them (`frame_messages` has it).
        index: position of the frame in the source; becomes the messages' sequence number.
        compression: of the chunk.

    Raises:
        StructureError: no mark of a frame among the messages, or an unknown topic.
    """
    records = _records(tuple(messages), index)
    times = [message.log_time_ns for message in _messages(records, 0)]
    name, packed = compressed(records, compression)
    chunk = PackedChunk(
        start_ns=min(times),
        end_ns=max(times),
        unpacked_bytes=len(records),
        unpacked_crc=crc32(records),
        compression=name,
        packed=packed,
    )
    return describe_chunk(chunk, records, offset=0)


def describe_chunk(chunk: PackedChunk, records: bytes | memoryview, *, offset: int) -> FrameChunk:
    """What a frame's chunk holds.

    Args:
        chunk: the chunk.
        records: its unpacked records.
        offset: byte in the file where it begins, for errors.

    Raises:
        RecordingError: it is not one frame.
    """
    entries: dict[int, MessageIndex] = {}
    frame_id = ""
    for message in _messages(records, offset):
        number = message.channel_id
        entry = entries.setdefault(number, MessageIndex(channel_id=number, records=[]))
        entry.records.append((message.log_time_ns, message.offset))
        if number == channel_id(FRAME):
            frame_id = _marked_frame(message, offset)
    if not frame_id:
        raise broken("a chunk that is not marked as a frame", offset)
    index, index_offsets = bytearray(), {}
    for number, entry in entries.items():
        index_offsets[number] = len(index)
        index += record_bytes(entry)
    return FrameChunk(
        frame_id=frame_id,
        head=chunk.head(),
        packed=chunk.packed,
        index=bytes(index),
        index_offsets=index_offsets,
        counts={number: len(entry.records) for number, entry in entries.items()},
        start_ns=chunk.start_ns,
        end_ns=chunk.end_ns,
        compression=chunk.compression,
        unpacked_bytes=len(records),
    )


def _records(messages: Sequence[LogMessage], index: int) -> bytes:
    """Schemas and channels that the messages use, then the messages."""
    numbers = [channel_id(message.topic) for message in messages]
    used = sorted(set(numbers))
    if channel_id(FRAME) not in used:
        raise StructureError("no mark of the frame", want=f"a message on {FRAME}", where="frame")
    parts: list[bytes | memoryview] = [
        schema_record(number) for number in sorted({schema_id(number) for number in used})
    ]
    parts += [channel_record(number) for number in used]
    for number, message in zip(numbers, messages, strict=True):
        time_ns, length = message.timestamp_ns, MESSAGE_HEADER.size + message.nbytes
        parts.append(RECORD_HEADER.pack(Opcode.MESSAGE, length))
        parts.append(MESSAGE_HEADER.pack(number, index % SEQUENCES, time_ns, time_ns))
        parts += message.parts
    return b"".join(parts)


def _messages(records: bytes | memoryview, offset: int) -> Iterator[RawMessage]:
    for record in inner_records(records, offset):
        if record.opcode == Opcode.MESSAGE:
            yield parse_message(record)


def _marked_frame(message: RawMessage, offset: int) -> str:
    try:
        return str(Log.FromString(bytes(message.data)).name)
    except DecodeError as error:
        raise broken("a mark of a frame that cannot be read", offset) from error
