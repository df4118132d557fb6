"""Values of YAML within a line or within brackets: scalars, `[...]` and `{...}`."""

from __future__ import annotations

import math
import re

from pseudolidar.formats.rigs.placed import DEEPEST, EXACT_INTEGER, Node, Value
from pseudolidar.formats.rigs.yaml_text import YamlText
from pseudolidar.formats.text import NUMBER

_INTEGER = re.compile(r"[+-]?(?:0|[1-9][0-9]*)")
_LEADING_ZEROS = re.compile(r"[+-]?0[0-9]")
_CONSTANTS: dict[str, Value] = {"true": True, "false": False, "null": None, "~": None, "": None}
_FLOW_KEY = re.compile(r"[^\s#,\[\]{}&*!|>'\"%@`?:][^\n#,\[\]{}:]*")
_PLAIN, _FLOW_PLAIN = re.compile(r"[^\n]*"), re.compile(r"[^\n#,\[\]{}]*")
_COMMENT = re.compile(r"[ \t]#")
# Characters that begin what is refused, and what to call it.
_REFUSED = {
    "&": "an anchor",
    "*": "an alias",
    "!": "a tag",
    "|": "a block text",
    ">": "a block text",
    "?": "a complex key",
    "%": "a directive",
    "@": "a reserved character",
    "`": "a reserved character",
}


class FlowValues:
    """Reads the value that begins at a place, and says where it ends.

    Args:
        text: the document.
    """

    def __init__(self, text: YamlText) -> None:
        self.yaml = text

    def inline(self, at: int, name: str, depth: int) -> tuple[Node, int]:
        """The value at `at`, which ends on its line or with its bracket.

        Raises:
            CalibrationSyntax: none, or too deep.
        """
        if depth > DEEPEST:
            raise self.yaml.error(at, f"more than {DEEPEST} levels deep", "less")
        match self.yaml[at]:
            case "[":
                return self._sequence(at, name, depth)
            case "{":
                return self._mapping(at, name, depth)
            case '"' | "'":
                text, end = self.yaml.quoted(at)
                return self.yaml.node(text, at, name), end
        return self._plain(at, name, _PLAIN)

    def _plain(self, at: int, name: str, form: re.Pattern[str]) -> tuple[Node, int]:
        mark = self.yaml[at]
        if mark in _REFUSED:
            raise self.yaml.error(
                at, f"{_REFUSED[mark]}, {self.yaml.found(at)}", "a plain value", name
            )
        match = form.match(self.yaml.text, at)
        token = _COMMENT.split(match[0], maxsplit=1)[0].rstrip(" \t") if match else ""
        if not token and form is _FLOW_PLAIN:
            raise self.yaml.unexpected(at, "a value", name)
        if ": " in token or token.endswith(":"):
            raise self.yaml.unexpected(at, "one key a line", name)
        return self.yaml.node(_scalar(token), at, name), at + len(token)

    def _within(self, at: int, name: str, depth: int) -> tuple[Node, int]:
        if self.yaml[at] in ("[", "{", "'", '"'):
            return self.inline(at, name, depth)
        return self._plain(at, name, _FLOW_PLAIN)

    def _sequence(self, start: int, name: str, depth: int) -> tuple[Node, int]:
        items: list[Node] = []
        at = self.yaml.skip(start + 1)
        while self.yaml[at] != "]":
            item, at = self._within(at, f"{name}[{len(items)}]", depth + 1)
            items.append(item)
            at = self._following(at, "]")
        return self.yaml.node(tuple(items), start, name), at + 1

    def _mapping(self, start: int, name: str, depth: int) -> tuple[Node, int]:
        fields: dict[str, Node] = {}
        places: dict[str, int] = {}
        at = self.yaml.skip(start + 1)
        while self.yaml[at] != "}":
            key, end = self._key(at)
            self.yaml.once(key, at, places)
            inner = f"{name}.{key}" if name else key
            fields[key], at = self._within(self.yaml.skip(end), inner, depth + 1)
            at = self._following(at, "}")
        return self.yaml.node(fields, start, name), at + 1

    def _key(self, at: int) -> tuple[str, int]:
        """A key within braces; OpenCV leaves no blank behind its colon."""
        if self.yaml[at] in ("'", '"'):
            key, end = self.yaml.quoted(at)
        else:
            match = _FLOW_KEY.match(self.yaml.text, at)
            key = match[0].rstrip(" \t") if match else ""
            end = at + len(key)
        end = self.yaml.skip(end)
        if not key or self.yaml[end] != ":":
            raise self.yaml.unexpected(at, "KEY: value")
        return key, end + 1

    def _following(self, at: int, end: str) -> int:
        """Where the next item or the closing bracket stands."""
        at = self.yaml.skip(at)
        mark = self.yaml[at]
        if mark == end:
            return at
        if mark != ",":
            raise self.yaml.unexpected(at, f"',' or {end!r}")
        return self.yaml.skip(at + 1)


def _scalar(token: str) -> Value:
    """A plain scalar: what is not clearly a number is text, and refused where a number is wanted.

    1_000, .inf, 0x10, 012 and 1,5 are such texts: readers of YAML do not agree about them.
    """
    if token.lower() in _CONSTANTS and token in (token.lower(), token.title(), token.upper()):
        return _CONSTANTS[token.lower()]
    if NUMBER.fullmatch(token) and not _LEADING_ZEROS.match(token):
        value = float(token)
        if _INTEGER.fullmatch(token) and abs(value) <= EXACT_INTEGER:
            return int(token)
        if math.isfinite(value):
            return value
    return token
