"""Serialised ROS messages to values, by their layout: CDR of ROS 2, and that of ROS 1.

Every length is checked against what is left before it is believed; arrays of numbers are views.
Source: OMG DDS-XTypes 1.3, plain CDR versions 1 and 2; ROS 1 message serialisation.
"""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import numpy as np

from pseudolidar.formats.ros.layout import STRING, Field, Layout

# Encapsulation identifiers of plain CDR: byte order, and the largest alignment.
ENCAPSULATIONS = {0: (">", 8), 1: ("<", 8), 6: (">", 4), 7: ("<", 4)}
ENCAPSULATION_BYTES = 4


def decode_cdr(layout: Layout, data: bytes | memoryview) -> SimpleNamespace:
    """The values of a ROS 2 message, by the names of its fields.

    Raises:
        ValueError: it ends early, or is encoded in another way.
    """
    if len(data) < ENCAPSULATION_BYTES:
        raise ValueError(f"{len(data)} bytes")
    kind = int.from_bytes(data[:2], "big")
    if kind not in ENCAPSULATIONS:
        raise ValueError(f"encapsulation {kind}, which is not plain CDR")
    order, alignment = ENCAPSULATIONS[kind]
    return _Reader(memoryview(data)[ENCAPSULATION_BYTES:], order, alignment).message(layout)


def decode_ros1(layout: Layout, data: bytes | memoryview) -> SimpleNamespace:
    """The values of a ROS 1 message: little-endian and without gaps.

    Raises:
        ValueError: it ends early.
    """
    return _Reader(memoryview(data), "<", 1).message(layout)


class _Reader:
    """Reads one message from its first byte on."""

    def __init__(self, data: memoryview, order: str, alignment: int) -> None:
        self._data, self._order, self._alignment = data, order, alignment
        self._at = 0

    def message(self, layout: Layout) -> SimpleNamespace:
        if not layout.fields and self._alignment > 1:
            self._take(1)  # ROS 2 gives an empty structure one byte
        return SimpleNamespace(**{field.name: self._field(field) for field in layout.fields})

    def _field(self, field: Field) -> Any:
        if not field.many:
            return self._value(field.kind)
        count = self._length() if field.count is None else field.count
        if isinstance(field.kind, str) and field.kind != STRING:
            return self._numbers(field.kind, count)
        if count > len(self._data) - self._at:  # each takes a byte at least
            raise ValueError(f"{count} items of {field.name} in {len(self._data)} bytes")
        return [self._value(field.kind) for _ in range(count)]

    def _value(self, kind: str | Layout) -> Any:
        if isinstance(kind, Layout):
            return self.message(kind)
        if kind == STRING:
            text = bytes(self._take(self._length()))
            return text.removesuffix(b"\0").decode("utf-8", "replace")
        return self._numbers(kind, 1)[0].item()

    def _length(self) -> int:
        self._align(4)
        (length,) = struct.unpack(f"{self._order}I", self._take(4))
        return int(length)

    def _numbers(self, kind: str, count: int) -> Any:
        dtype = np.dtype(self._order + kind)
        if count:
            self._align(dtype.itemsize)
        return np.frombuffer(self._take(count * dtype.itemsize), dtype)

    def _align(self, size: int) -> None:
        self._at += -self._at % min(size, self._alignment)

    def _take(self, size: int) -> memoryview:
        left = len(self._data) - self._at
        if size > left:
            raise ValueError(f"{size} bytes wanted at byte {self._at}, {max(left, 0)} are left")
        self._at += size
        return self._data[self._at - size : self._at]
