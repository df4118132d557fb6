"""Records of ROS 1 bags out of untrusted bytes: headers, chunks and the messages in them."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import FileIO

import lz4.frame  # type: ignore[import-untyped]

from pseudolidar.errors import RecordingError
from pseudolidar.formats.limits import Limits, raise_cap
from pseudolidar.formats.mcap.records import broken

OP_MESSAGE, OP_INDEX, OP_CHUNK, OP_CONNECTION = 2, 4, 5, 7
MOST_HEADER_BYTES = 2**20
_LENGTH = struct.Struct("<I")


@dataclass(frozen=True)
class Record:
    """A record.

    Args:
        fields: of its header, by name.
        data: what follows the header.
        offset: where it begins, in the file or its chunk.
        end: where it ends.
    """

    fields: dict[bytes, bytes]
    data: bytes | memoryview
    offset: int
    end: int

    @property
    def op(self) -> int:
        """What it is: one of the `OP_` numbers; 0 where it does not say."""
        return self.fields.get(b"op", b"\0")[0]

    def number(self, name: bytes) -> int:
        """A number of the header.

        Raises:
            RecordingError: there is none of that name.
        """
        value = self.fields.get(name, b"")
        if not 1 <= len(value) <= 8:
            raise broken(f"a record without {name.decode()}", self.offset)
        return int.from_bytes(value, "little")


def read_record(file: FileIO, offset: int, size: int, limits: Limits) -> Record:
    """The record at `offset` of a file of `size` bytes.

    Raises:
        RecordingError: the file ends within it, or it claims more than there is.
    """
    file.seek(offset)
    header = _sized(file, offset, size, MOST_HEADER_BYTES)
    data = _sized(file, file.tell(), size, limits.record_bytes)
    return Record(header_fields(header, offset), data, offset, file.tell())


def _sized(file: FileIO, at: int, size: int, most: int) -> bytes:
    head = file.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise broken(f"the file ends after {size} bytes, within a record", at)
    (length,) = _LENGTH.unpack(head)
    if length > min(most, size - at - _LENGTH.size):
        raise broken(f"a record that claims {length} bytes", at)
    return file.read(length)


def header_fields(data: bytes | memoryview, offset: int) -> dict[bytes, bytes]:
    """The fields NAME=VALUE of a header.

    Raises:
        RecordingError: not of that form.
    """
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


def inner_records(data: bytes, offset: int, at: int = 0) -> Iterator[Record]:
    """Records of an unpacked chunk, which stands at `offset` of the file, from byte `at` on.

    Raises:
        RecordingError: the chunk ends within one.
    """
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
        yield Record(header_fields(parts[0], offset), parts[1], start, at)


def message_at(chunk: bytes, offset: int, start: int) -> memoryview:
    """The message at `offset` of an unpacked chunk; its connection may stand before it.

    Raises:
        RecordingError: there is none.
    """
    for record in inner_records(chunk, start, offset):
        if record.op == OP_MESSAGE:
            return memoryview(record.data)
        if record.op != OP_CONNECTION:
            break
    raise broken("no message where the index has one", start)


def unpacked(chunk: Record, limits: Limits) -> bytes:
    """The records of a chunk, to no more than it claims and the caps allow.

    Raises:
        RecordingError: no chunk, one that claims too much, or a damaged one.
    """
    size, name = chunk.number(b"size"), chunk.fields.get(b"compression", b"")
    if chunk.op != OP_CHUNK or size > limits.allowed_unpacked(len(chunk.data)):
        raise RecordingError(
            f"a chunk of {len(chunk.data)} bytes that claims to unpack to {size}",
            want=f"at most {limits.chunk_bytes}, and {limits.chunk_expansion} times its size",
            fix=raise_cap("chunk_expansion"),
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
