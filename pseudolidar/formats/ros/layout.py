"""Definitions of ROS messages as layouts to read by: `.msg` texts of bags, or the standard ones.

Source: ROS 2 interface definitions; ROS 1 `.msg` grammar.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pseudolidar.formats.ros.ros2_definitions import DEFINITIONS

# NumPy codes of the primitive types of either ROS.
PRIMITIVES: Mapping[str, str] = {
    "bool": "u1", "byte": "u1", "char": "u1", "octet": "u1",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
STRING = "string"
# ROS 1 has these as primitives; ROS 2 as messages.
ROS1_TIMES = {"time": "uint32 secs\nuint32 nsecs", "duration": "int32 secs\nint32 nsecs"}
# Deeper nesting than any message has; a definition that holds itself is endless.
DEEPEST = 16
MOST_VALUES = 10_000

_SEPARATOR = re.compile(r"^={3,}[ \t]*$", re.MULTILINE)
_NAME = re.compile(r"^MSG:[ \t]*(\S+)[ \t]*$", re.MULTILINE)
# A constant has a value after its name; a default has no equals sign.
_CONSTANT = re.compile(r"[\w/]+(?:<=[0-9]+)?[ \t]+\w+[ \t]*=")
_FIELD = re.compile(
    r"(?P<kind>[A-Za-z][\w/]*)(?P<bound><=[0-9]+)?"
    r"(?P<array>\[(?:<=)?(?P<count>[0-9]*)\])?[ \t]+(?P<name>[A-Za-z]\w*)(?:[ \t].*)?"
)


@dataclass(frozen=True)
class Field:
    """One field of a layout.

    Args:
        name: as the definition has it.
        kind: code of a primitive, `string`, or the layout of a nested message.
        many: whether it is an array.
        count: of an array of fixed length, else None.
    """

    name: str
    kind: str | Layout
    many: bool = False
    count: int | None = None


@dataclass(frozen=True)
class Layout:
    """A message as the fields that follow one another.

    Args:
        name: of the type.
        fields: in order.
    """

    name: str
    fields: tuple[Field, ...]


def plain_name(name: str) -> str:
    """`package/Type` of `package/msg/Type`."""
    return name.replace("/msg/", "/")


def standard_layout(name: str) -> Layout | None:
    """The layout of a standard message, None for other types."""
    plain = plain_name(name)
    return _Definitions(DEFINITIONS).layout(plain) if plain in DEFINITIONS else None


def parse_layout(name: str, text: str) -> Layout:
    """The layout that a definition with all that it refers to describes.

    Args:
        name: of the type.
        text: as bags hold it: definitions separated by lines of `=`, each but the first headed by
            `MSG: package/Type`.

    Raises:
        ValueError: not such a text, a type that is not in it, or one that holds itself.
    """
    known: dict[str, str] = dict(ROS1_TIMES)
    for number, part in enumerate(_SEPARATOR.split(text)):
        title = _NAME.search(part)
        if number and title is None:
            raise ValueError("a part of the definition without a name")
        known[plain_name(name if title is None else title[1])] = _NAME.sub("", part, count=1)
    for missing in ("builtin_interfaces/Time", "builtin_interfaces/Duration"):
        known.setdefault(missing, DEFINITIONS[missing])
    return _Definitions(known).layout(plain_name(name))


class _Definitions:
    """Texts of definitions by name, each made a layout once."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = texts
        self._layouts: dict[str, Layout] = {}
        # Single values that a message has at least: nesting multiplies them.
        self._values: dict[str, int] = {}

    def layout(self, name: str, depth: int = 0) -> Layout:
        if depth > DEEPEST:
            raise ValueError(f"{name} holds itself")
        if name not in self._layouts:
            if name not in self._texts:
                raise ValueError(f"no definition of {name}")
            fields = tuple(self._fields(name, depth))
            nested = (f.kind.name for f in fields if isinstance(f.kind, Layout))
            self._values[name] = len(fields) + sum(self._values[other] for other in nested)
            if self._values[name] > MOST_VALUES:
                raise ValueError(f"more than {MOST_VALUES} values in {name}")
            self._layouts[name] = Layout(name, fields)
        return self._layouts[name]

    def _fields(self, owner: str, depth: int) -> Iterator[Field]:
        for line in self._texts[owner].splitlines():
            text = line.partition("#")[0].strip()
            if not text or _CONSTANT.match(text):
                continue
            match = _FIELD.fullmatch(text)
            if match is None:
                raise ValueError(f"{text[:60]!r} in {owner}")
            array: str | None = match["array"]
            fixed = int(match["count"]) if match["count"] and "<=" not in (array or "") else None
            kind = self._kind(str(match["kind"]), owner, depth)
            yield Field(str(match["name"]), kind, array is not None, fixed)

    def _kind(self, kind: str, owner: str, depth: int) -> str | Layout:
        if kind in PRIMITIVES:
            return PRIMITIVES[kind]
        if kind == STRING:
            return STRING
        return self.layout(self._full_name(plain_name(kind), owner), depth + 1)

    def _full_name(self, kind: str, owner: str) -> str:
        """A type with its package: that of the owner, or where no such type is, the only one's."""
        own = f"{owner.partition('/')[0]}/{kind}"
        named = [name for name in self._texts if name.endswith(f"/{kind}")]
        candidates: list[str] = [kind, own, *(named if len(named) == 1 else ())]
        for name in candidates:
            if name in self._texts:
                return name
        raise ValueError(f"no definition of {kind}")
