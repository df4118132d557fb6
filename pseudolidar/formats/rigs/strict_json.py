"""JSON that people write by hand: strict, and every value knows its line.

Python's own reader takes the last of two equal keys, takes NaN, and forgets lines.
Source: RFC 8259.
"""

from __future__ import annotations

import bisect
import math
import re
from dataclasses import dataclass
from json import JSONDecodeError, JSONDecoder
from pathlib import Path

from pseudolidar.errors import CalibrationField, CalibrationSyntax, LimitError

DEEPEST = 32
# Values of a file: a calibration with the corners of all its pictures has some thousands, and each
# value takes some 300 bytes of memory.
MOST_VALUES = 100_000
_SPACE = re.compile(r"[ \t\r\n]*")
_TOKEN = re.compile(r"[^\s,\]}:\"\[{]*")
_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?")
_CONSTANTS = {"true": True, "false": False, "null": None}
# Integers up to here are exact in the float64 of other readers.
EXACT_INTEGER = 2**53
LONGEST_SHOWN = 40

Value = str | int | float | bool | None | tuple["JsonNode", ...] | dict[str, "JsonNode"]


@dataclass(frozen=True)
class JsonNode:
    """A value with its place.

    Args:
        value: a scalar, a tuple of nodes, or a dict of nodes.
        where: path within the file and line ("left.K[0], line 4").
        path: the file.
    """

    value: Value
    where: str
    path: str


def parse_json(text: str, path: str | Path) -> JsonNode:
    """Parse `text`; `path` names it in errors.

    Raises:
        CalibrationSyntax: not JSON, a number that is not finite, too deep; with line and column.
        CalibrationField: a key twice in one object, with both lines.
        LimitError: more than 100 000 values.
    """
    parser = _Parser(text, str(path))
    node, at = parser.value(parser.skip(0), "", 0)
    if parser.skip(at) != len(text):
        raise parser.error(parser.skip(at), "text after the end", "one JSON value")
    return node


def too_many_values(path: str, where: str) -> LimitError:
    """The error of a file with more values than any calibration has."""
    return LimitError(
        f"more than {MOST_VALUES} values", want="a calibration", path=path, where=where
    )


class _Parser:
    """Recursive descent over one text; positions are character offsets."""

    def __init__(self, text: str, path: str) -> None:
        self.text, self.path = text, path
        self.lines = [0, *(match.end() for match in re.finditer("\n", text))]
        self.values = 0

    def line(self, at: int) -> int:
        return bisect.bisect(self.lines, at)

    def skip(self, at: int) -> int:
        match = _SPACE.match(self.text, at)
        return match.end() if match else at

    def error(self, at: int, got: str, want: str, name: str = "") -> CalibrationSyntax:
        line = self.line(at)
        column = at - self.lines[line - 1] + 1
        where = f"line {line}, column {column}"
        return CalibrationSyntax(
            got, want=want, path=self.path, where=f"{name}, {where}" if name else where
        )

    def node(self, value: Value, at: int, name: str) -> JsonNode:
        self.values += 1
        if self.values > MOST_VALUES:
            raise too_many_values(self.path, f"line {self.line(at)}")
        where = f"line {self.line(at)}"
        return JsonNode(value, f"{name}, {where}" if name else where, self.path)

    def value(self, at: int, name: str, depth: int) -> tuple[JsonNode, int]:
        if depth > DEEPEST:
            raise self.error(at, f"more than {DEEPEST} brackets deep", "less")
        match self.text[at : at + 1]:
            case "{":
                return self.object(at, name, depth)
            case "[":
                return self.array(at, name, depth)
            case '"':
                text, end = self.string(at)
                return self.node(text, at, name), end
            case _:
                return self.scalar(at, name)

    def object(self, start: int, name: str, depth: int) -> tuple[JsonNode, int]:
        fields: dict[str, JsonNode] = {}
        places: dict[str, int] = {}
        at = self.skip(start + 1)
        while self.text[at : at + 1] != "}":
            key, end = self.string(at)
            if key in fields:
                lines = f"lines {self.line(places[key])} and {self.line(at)}"
                raise CalibrationField(
                    f"{key!r} twice", want="once", fix="Remove one.", path=self.path, where=lines
                )
            end = self.expect(self.skip(end), ":")
            places[key] = at
            inner = f"{name}.{key}" if name else key
            fields[key], at = self.value(self.skip(end), inner, depth + 1)
            at = self.following(at, "}")
        return self.node(fields, start, name), at + 1

    def array(self, start: int, name: str, depth: int) -> tuple[JsonNode, int]:
        items: list[JsonNode] = []
        at = self.skip(start + 1)
        while self.text[at : at + 1] != "]":
            item, at = self.value(at, f"{name}[{len(items)}]", depth + 1)
            items.append(item)
            at = self.following(at, "]")
        return self.node(tuple(items), start, name), at + 1

    def following(self, at: int, end: str) -> int:
        """Where the next item or the closing bracket stands."""
        at = self.skip(at)
        if self.text[at : at + 1] == end:
            return at
        after = self.skip(self.expect(at, ","))
        if self.text[after : after + 1] == end:
            raise self.error(at, "a comma after the last item", f"{end!r}")
        return after

    def expect(self, at: int, mark: str) -> int:
        if self.text[at : at + 1] != mark:
            raise self.error(at, self.found(at), f"{mark!r}")
        return at + 1

    def string(self, at: int) -> tuple[str, int]:
        if self.text[at : at + 1] != '"':
            raise self.error(at, self.found(at), "a name in double quotes")
        try:
            text, end = JSONDecoder().raw_decode(self.text, at)
        except JSONDecodeError as error:
            raise self.error(error.pos, error.msg, "a legal string") from None
        return str(text), end

    def scalar(self, at: int, name: str) -> tuple[JsonNode, int]:
        match = _TOKEN.match(self.text, at)
        token = match[0] if match else ""
        end = at + len(token)
        if token in _CONSTANTS:
            return self.node(_CONSTANTS[token], at, name), end
        number = _NUMBER.fullmatch(token)
        if number is None:
            raise self.error(at, self.found(at), "a value such as 0.54", name)
        value = float(token)
        if not math.isfinite(value):
            raise self.error(at, self.found(at), "a finite number", name)
        whole = number[1] is None and number[2] is None and abs(value) <= EXACT_INTEGER
        return self.node(int(token) if whole else value, at, name), end

    def found(self, at: int) -> str:
        """What stands at `at`, in words."""
        if at >= len(self.text):
            return "the end of the file"
        match = _TOKEN.match(self.text, at)
        return repr(((match and match[0]) or self.text[at])[:LONGEST_SHOWN])
