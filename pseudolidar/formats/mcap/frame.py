"""One frame of a recording as bytes: a few chunks that depend on no other frame.

Workers pack their frames; whoever writes the file only appends. Each chunk declares the topics it
uses, so that its bytes are the same wherever it stands, and it can be read after any damage
elsewhere. The last chunk of a frame, and no other, has the frame's mark: a frame is there when its
last chunk is.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from google.protobuf.message import DecodeError
from mcap.opcode import Opcode
from mcap.records import MessageIndex

from pseudolidar.errors import StructureError
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.mcap.channels import FRAME
from pseudolidar.formats.mcap.compression import compressed
from pseudolidar.formats.mcap.content import Compression
from pseudolidar.formats.mcap.profile import Profile
from pseudolidar.formats.mcap.records import (
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
    from pseudolidar.formats.mcap.messages import LogMessage

# Values of a message's sequence number.
SEQUENCES = 2**32
# Unpacked chunks are no larger than this, but for a single message that is.
CHUNK_BYTES = 4_000_000
# A message of this size has a chunk of its own: who wants pictures need not read clouds.
LARGE_BYTES = 1_000_000


@dataclass(frozen=True, eq=False)
class IndexedChunk:
    """A chunk and the index of its messages, ready to be appended to a recording.

    Args:
        head: the chunk record up to its packed records.
        packed: its packed records.
        index: the message index records that follow the chunk.
        index_offsets: where in `index` each channel's record begins, by channel.
        counts: messages by channel.
        start_ns: earliest time stamp.
        end_ns: latest time stamp.
        compression: as the file names it.
        unpacked_bytes: size of the records.
        marks: the frame that it is the last chunk of, None for any other.
    """

    head: bytes
    packed: bytes | memoryview
    index: bytes
    index_offsets: Mapping[int, int]
    counts: Mapping[int, int]
    start_ns: int
    end_ns: int
    compression: str
    unpacked_bytes: int
    marks: str | None

    @property
    def nbytes(self) -> int:
        """Bytes that it adds to the file, besides some 200 in the summary."""
        return self.chunk_bytes + len(self.index)

    @property
    def chunk_bytes(self) -> int:
        """Length of the chunk record."""
        return len(self.head) + len(self.packed)

    @property
    def parts(self) -> tuple[bytes | memoryview, ...]:
        """Its bytes, in pieces."""
        return self.head, self.packed, self.index


@dataclass(frozen=True, eq=False)
class FramePart:
    """A frame's part of a recording.

    Args:
        frame_id: the source's name of the frame.
        chunks: in the order of the file; the last one has the frame's mark.
    """

    frame_id: str
    chunks: tuple[IndexedChunk, ...]

    @property
    def nbytes(self) -> int:
        """Bytes that it adds to the file, besides the summary."""
        return sum(chunk.nbytes for chunk in self.chunks)

    @property
    def parts(self) -> tuple[bytes | memoryview, ...]:
        """Its bytes, in pieces."""
        return tuple(part for chunk in self.chunks for part in chunk.parts)

    @property
    def start_ns(self) -> int:
        """Earliest time stamp."""
        return min(chunk.start_ns for chunk in self.chunks)


def pack_frame(
    messages: Iterable[LogMessage], *, index: int, compression: Compression = "lz4"
) -> FramePart:
    """Pack the messages of one frame; pure, for worker threads.

    Large messages come first, each in a chunk of its own, the others after them in chunks of up to
    4 MB, the mark of the frame last of all.

    Args:
        messages: of one frame, the mark of the frame among them (`frame_messages` has it).
        index: position of the frame in the source; becomes the messages' sequence number.
        compression: of the chunks.

    Raises:
        StructureError: not one mark of a frame among the messages.
    """
    given = tuple(messages)
    marks = [message for message in given if message.channel == Profile.MARK_ID]
    if len(marks) != 1:
        raise StructureError(
            f"{len(marks)} marks of the frame", want=f"one message on {FRAME}", where="frame"
        )
    large = [message for message in given if message.nbytes >= LARGE_BYTES]
    small = [m for m in given if m.nbytes < LARGE_BYTES and m is not marks[0]]
    groups = [*([message] for message in large), *_groups([*small, *marks])]
    chunks = tuple(_packed(group, index, compression) for group in groups)
    frame_id = chunks[-1].marks
    assert frame_id is not None
    return FramePart(frame_id, chunks)


def with_more(
    part: FramePart,
    messages: Sequence[LogMessage],
    *,
    index: int,
    compression: Compression = "lz4",
) -> FramePart:
    """A frame with messages that are known later than the others, before its mark.

    Args:
        part: as `pack_frame` made it; its chunks stay as they are.
        messages: small ones.
        index: position of the frame in the source.
        compression: of the chunks that are added.
    """
    if not messages:
        return part
    added = tuple(_packed(group, index, compression) for group in _groups(messages))
    return FramePart(part.frame_id, (*part.chunks[:-1], *added, part.chunks[-1]))


def describe_chunk(
    chunk: PackedChunk, records: bytes | memoryview, profile: Profile, *, offset: int
) -> IndexedChunk:
    """What a chunk of a frame holds.

    Args:
        chunk: the chunk.
        records: its unpacked records.
        profile: of the recording.
        offset: byte in the file where it begins, for errors.

    Raises:
        RecordingError: it cannot be part of a frame.
    """
    entries: dict[int, MessageIndex] = {}
    times = set[int]()
    frame_id = None
    for message in _messages(records, offset):
        number = message.channel_id
        entry = entries.setdefault(number, MessageIndex(channel_id=number, records=[]))
        entry.records.append((message.log_time_ns, message.offset))
        times.add(message.log_time_ns)
        if number == profile.MARK_ID:
            frame_id = _marked_frame(message, profile, offset)
        elif not 0 < number <= len(profile.topics):
            raise broken(f"a message on undeclared channel {number}", offset)
    if not times or (min(times), max(times)) != (chunk.start_ns, chunk.end_ns):
        raise broken("a chunk of other times than its messages have", offset)
    index, index_offsets = bytearray(), {}
    for number, entry in entries.items():
        index_offsets[number] = len(index)
        index += record_bytes(entry)
    return IndexedChunk(
        head=chunk.head(),
        packed=chunk.packed,
        index=bytes(index),
        index_offsets=index_offsets,
        counts={number: len(entry.records) for number, entry in entries.items()},
        start_ns=chunk.start_ns,
        end_ns=chunk.end_ns,
        compression=chunk.compression,
        unpacked_bytes=len(records),
        marks=frame_id,
    )


def _groups(messages: Sequence[LogMessage]) -> Iterator[Sequence[LogMessage]]:
    """The messages in order, cut where a chunk would become too large."""
    begin, channels, size = 0, set[int](), 0
    for end, message in enumerate(messages):
        channels.add(message.channel)
        size += RECORD_HEADER.size + MESSAGE_HEADER.size + message.nbytes
        if end > begin and size + len(message.profile.declarations(channels)) > CHUNK_BYTES:
            yield messages[begin:end]
            begin, channels = end, {message.channel}
            size = RECORD_HEADER.size + MESSAGE_HEADER.size + message.nbytes
    yield messages[begin:]


def _packed(messages: Sequence[LogMessage], index: int, compression: Compression) -> IndexedChunk:
    records = _records(messages, index)
    times = [message.timestamp_ns for message in messages]
    name, packed = compressed(records, compression)
    chunk = PackedChunk(
        start_ns=min(times),
        end_ns=max(times),
        unpacked_bytes=len(records),
        unpacked_crc=crc32(records),
        compression=name,
        packed=packed,
    )
    return describe_chunk(chunk, records, messages[0].profile, offset=0)


def _records(messages: Sequence[LogMessage], index: int) -> bytes:
    """Schemas and channels that the messages use, then the messages."""
    used = {message.channel for message in messages}
    parts: list[bytes | memoryview] = [messages[0].profile.declarations(used)]
    for message in messages:
        time_ns, length = message.timestamp_ns, MESSAGE_HEADER.size + message.nbytes
        parts.append(RECORD_HEADER.pack(Opcode.MESSAGE, length))
        parts.append(MESSAGE_HEADER.pack(message.channel, index % SEQUENCES, time_ns, time_ns))
        parts += message.parts
    return b"".join(parts)


def _messages(records: bytes | memoryview, offset: int) -> Iterator[RawMessage]:
    for record in inner_records(records, offset):
        if record.opcode == Opcode.MESSAGE:
            yield parse_message(record)


def _marked_frame(message: RawMessage, profile: Profile, offset: int) -> str:
    try:
        return profile.frame_name(bytes(message.data))
    except (DecodeError, ValueError, struct.error) as error:
        raise broken("a mark of a frame that cannot be read", offset) from error
