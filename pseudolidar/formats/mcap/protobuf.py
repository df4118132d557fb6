"""Serialising of protobuf messages whose payload is large."""

from __future__ import annotations

from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from pseudolidar.formats.mcap.profile import Schema
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.structures.arrays import AnyArray

PROTOBUF = "protobuf"
# Wire type of a length-delimited field (protobuf encoding specification).
LENGTH_DELIMITED = 2


def schema_of(message: Any) -> Schema:
    """The schema of a class of messages, with everything that its file imports, imports first."""
    files: dict[str, Any] = {}

    def add(file: Any) -> None:
        for imported in file.dependencies:
            if imported.name not in files:
                add(imported)
        files.setdefault(file.name, file)

    add(message.DESCRIPTOR.file)
    result = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(result.file.add())
    data = result.SerializeToString(deterministic=True)
    return Schema(message.DESCRIPTOR.full_name, PROTOBUF, data)


def set_stamp(stamp: Any, timestamp_ns: int) -> None:
    """Fill a `google.protobuf.Timestamp`."""
    stamp.seconds, stamp.nanos = divmod(timestamp_ns, NS_PER_S)


def serialised(message: Any) -> Parts:
    """The message as one piece."""
    return (message.SerializeToString(),)


def with_data(message: Any, data: bytes | AnyArray) -> Parts:
    """The serialised message with `data` as its field `data`, in pieces, without a copy of `data`.

    Fields may come in any order on the wire, so the large one is appended to the others; going
    through the message object costs three copies.
    """
    number = message.DESCRIPTOR.fields_by_name["data"].number
    array = np.frombuffer(data, np.uint8) if isinstance(data, bytes) else data
    payload = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
    key = _varint(number << 3 | LENGTH_DELIMITED)
    return message.SerializeToString() + key + _varint(len(payload)), payload


def _varint(value: int) -> bytes:
    """Base-128, least significant group first, high bit set on all but the last."""
    groups = bytearray()
    while value > 0x7F:
        groups.append(value & 0x7F | 0x80)
        value >>= 7
    groups.append(value)
    return bytes(groups)
