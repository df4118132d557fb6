"""ROS 2 messages as CDR, written by their definitions: the text that is stored is what is followed.

Source: OMG DDS-XTypes 1.3, plain CDR version 1, little-endian; ROS 2 interface definitions.
"""

from __future__ import annotations

import functools
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.ros.ros2_definitions import DEFINITIONS

# Encapsulation: plain CDR, little-endian, no options. Alignment counts from the byte after it.
ENCAPSULATION = b"\x00\x01\x00\x00"
SEPARATOR = "=" * 80
# Arrays of bytes from this size on are not copied into the message but stand beside its parts.
APART_BYTES = 4096

_PRIMITIVES = {
    "bool": "?",
    "byte": "B",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_FIELD = re.compile(r"([\w/]+)(\[(\d*)\])? (\w+)$")


@dataclass(frozen=True)
class RosField:
    """One field of a definition.

    Args:
        name: as in the definition.
        kind: primitive, `string`, or the name of another definition.
        many: whether it is an array.
        count: length of an array of fixed length, else None.
    """

    name: str
    kind: str
    many: bool
    count: int | None


def encode_ros2(kind: str, values: Mapping[str, Any]) -> Parts:
    """A serialised message, in pieces; large arrays of bytes are not copied.

    Args:
        kind: name of its definition, `package/Type`.
        values: by field name; nested messages are mappings, arrays are sequences, arrays of bytes
            anything with the buffer protocol. What is left out is zero, empty or false.

    Raises:
        StructureError: a field that the definition has not, or an array of another length.
    """
    writer = _Writer()
    writer.message(kind, values)
    return writer.finished()


@functools.cache
def fields_of(kind: str) -> tuple[RosField, ...]:
    """The fields of a definition in order."""
    fields = []
    for line in DEFINITIONS[kind].splitlines():
        if "=" in line:  # a constant
            continue
        match = _FIELD.match(line)
        assert match is not None, line
        kind_name, brackets, count, name = match.groups()
        fields.append(RosField(name, kind_name, bool(brackets), int(count) if count else None))
    return tuple(fields)


@functools.cache
def definition_text(kind: str) -> str:
    """The definition and all that it refers to, as MCAP and ROS 2 bags store it (`ros2msg`)."""
    found: dict[str, None] = {}

    def add(name: str) -> None:
        for field in fields_of(name):
            if field.kind in DEFINITIONS and field.kind not in found:
                found[field.kind] = None
                add(field.kind)

    add(kind)
    texts = [DEFINITIONS[kind], *(f"MSG: {name}\n{DEFINITIONS[name]}" for name in found)]
    return f"\n{SEPARATOR}\n".join(texts) + "\n"


def schema_name(kind: str) -> str:
    """`package/msg/Type` of `package/Type`."""
    return kind.replace("/", "/msg/")


class _Writer:
    """Collects one message."""

    def __init__(self) -> None:
        self._parts: list[bytes | memoryview] = []
        self._buffer = bytearray(ENCAPSULATION)
        # Bytes before the buffer, less the encapsulation.
        self._before = -len(ENCAPSULATION)

    def finished(self) -> Parts:
        return (*self._parts, bytes(self._buffer))

    def message(self, kind: str, values: Mapping[str, Any]) -> None:
        fields = fields_of(kind)
        unknown = values.keys() - {field.name for field in fields}
        if unknown:
            raise StructureError(f"fields {sorted(unknown)}", want=f"those of {kind}", where=kind)
        for field in fields:
            self._field(field, values.get(field.name))

    def _field(self, field: RosField, value: Any) -> None:
        if field.many:
            self._array(field, value)
        elif field.kind in _PRIMITIVES:
            self._numbers(_PRIMITIVES[field.kind], (value or 0,))
        elif field.kind == "string":
            self._string(value or "")
        else:
            self.message(field.kind, value or {})

    def _array(self, field: RosField, value: Any) -> None:
        if value is None:
            value = [0] * (field.count or 0)
        if field.kind == "uint8":
            value = _bytes_of(value)
        length = len(value)
        if field.count is None:
            self._numbers("I", (length,))
        elif length != field.count:
            raise StructureError(f"{length} values", want=str(field.count), where=field.name)
        if field.kind == "uint8":
            self._bytes(value)
        elif field.kind in _PRIMITIVES:
            self._numbers(_PRIMITIVES[field.kind], value)
        else:
            write = self._string if field.kind == "string" else None
            for item in value:
                write(item) if write else self.message(field.kind, item)

    def _numbers(self, code: str, values: Sequence[Any]) -> None:
        if len(values):
            size = struct.calcsize(code)
            self._buffer += bytes(-(self._before + len(self._buffer)) % size)
            self._buffer += struct.pack(f"<{len(values)}{code}", *values)

    def _string(self, text: str) -> None:
        data = text.encode("utf-8", "replace") + b"\0"
        self._numbers("I", (len(data),))
        self._buffer += data

    def _bytes(self, view: memoryview) -> None:
        if view.nbytes < APART_BYTES:
            self._buffer += view
            return
        self._parts += [bytes(self._buffer), view]
        self._before += len(self._buffer) + view.nbytes
        self._buffer = bytearray()


def _bytes_of(value: Any) -> memoryview:
    """Bytes as one line, whatever holds them."""
    if isinstance(value, np.ndarray):
        return value.reshape(-1).view(np.uint8).data
    return memoryview(bytes(value) if isinstance(value, list) else value)
