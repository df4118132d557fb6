"""JSON that people write by hand: strict, and every value knows its line.

Python's own reader takes the last of two equal keys, takes NaN, and forgets lines.
Source: RFC 8259.
"""

from __future__ import annotations

import math
import re
from json import JSONDecodeError, JSONDecoder
from pathlib import Path

from pseudolidar.formats.rigs.placed import DEEPEST, EXACT_INTEGER, Node, Places, Value
from pseudolidar.formats.text import LONGEST_SHOWN

_SPACE = re.compile(r"[ \t\r\n]*")
_TOKEN = re.compile(r"[^\s,\]}:\"\[{]*")
_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?")
_CONSTANTS = {"true": True, "false": False, "null": None}


def parse_json(text: str, path: str | Path) -> Node:
    """Parse `text`; `path` names it in errors.

    Raises:
        CalibrationSyntax: not JSON, a number that is not finite, too deep; with line and column.
        CalibrationField: a key twice in one object, with both lines.
        LimitError: more than 100 000 values.
    """
    parser = _Parser(text, str(path))
    node, at = parser.value(parser.skip(0), "", 0)
    if parser.skip(at) != len(text):
        raise parser.places.error(parser.skip(at), "text after the end", "one JSON value")
    return node


class _Parser:
    """Recursive descent over one text; positions are character offsets."""

    def __init__(self, text: str, path: str) -> None:
        self.text, self.places = text, Places(text, path)

    def skip(self, at: int) -> int:
        match = _SPACE.match(self.text, at)
        return match.end() if match else at

    def node(self, value: Value, at: int, name: str) -> Node:
        self.places.count(at)
        where = f"line {self.places.line(at)}"
        return Node(value, f"{name}, {where}" if name else where, self.places.path)

    def value(self, at: int, name: str, depth: int) -> tuple[Node, int]:
        if depth > DEEPEST:
            raise self.places.error(at, f"more than {DEEPEST} brackets deep", "less")
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

    def object(self, start: int, name: str, depth: int) -> tuple[Node, int]:
        fields: dict[str, Node] = {}
        places: dict[str, int] = {}
        at = self.skip(start + 1)
        while self.text[at : at + 1] != "}":
            key, end = self.string(at)
            if key in fields:
                raise self.places.twice(key, places[key], at)
            end = self.expect(self.skip(end), ":")
            places[key] = at
            inner = f"{name}.{key}" if name else key
            fields[key], at = self.value(self.skip(end), inner, depth + 1)
            at = self.following(at, "}")
        return self.node(fields, start, name), at + 1

    def array(self, start: int, name: str, depth: int) -> tuple[Node, int]:
        items: list[Node] = []
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
            raise self.places.error(at, "a comma after the last item", f"{end!r}")
        return after

    def expect(self, at: int, mark: str) -> int:
        if self.text[at : at + 1] != mark:
            raise self.places.error(at, self.found(at), f"{mark!r}")
        return at + 1

    def string(self, at: int) -> tuple[str, int]:
        if self.text[at : at + 1] != '"':
            raise self.places.error(at, self.found(at), "a name in double quotes")
        try:
            text, end = JSONDecoder().raw_decode(self.text, at)
        except JSONDecodeError as error:
            raise self.places.error(error.pos, error.msg, "a legal string") from None
        return str(text), end

    def scalar(self, at: int, name: str) -> tuple[Node, int]:
        match = _TOKEN.match(self.text, at)
        token = match[0] if match else ""
        end = at + len(token)
        if token in _CONSTANTS:
            return self.node(_CONSTANTS[token], at, name), end
        number = _NUMBER.fullmatch(token)
        if number is None:
            raise self.places.error(at, self.found(at), "a value such as 0.54", name)
        value = float(token)
        if not math.isfinite(value):
            raise self.places.error(at, self.found(at), "a finite number", name)
        whole = number[1] is None and number[2] is None and abs(value) <= EXACT_INTEGER
        return self.node(int(token) if whole else value, at, name), end

    def found(self, at: int) -> str:
        """What stands at `at`, in words."""
        if at >= len(self.text):
            return "the end of the file"
        match = _TOKEN.match(self.text, at)
        return repr(((match and match[0]) or self.text[at])[:LONGEST_SHOWN])
