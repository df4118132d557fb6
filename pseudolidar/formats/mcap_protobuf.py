"""Serialising of protobuf messages whose payload is large."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from pseudolidar.errors import SequenceTime
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.structures.arrays import AnyArray

# Wire type of a length-delimited field (protobuf encoding specification).
LENGTH_DELIMITED = 2

# A serialised message in pieces; their concatenation is the message.
Parts: TypeAlias = tuple[bytes | memoryview, ...]


def set_stamp(stamp: Any, timestamp_ns: int) -> None:
    """Fill a `google.protobuf.Timestamp`.

    Raises:
        SequenceTime: not after 1970, which viewers take for "no time".
    """
    if timestamp_ns <= 0:
        raise SequenceTime(f"time stamp {timestamp_ns} ns", want="a positive number")
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
