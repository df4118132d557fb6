"""The part of YAML that calibration files use: strict, and every value knows its line and column.

Block and flow mappings and sequences, plain and quoted scalars, comments, several documents, and
the one tag `!!opencv-matrix`. Anchors, aliases, other tags, merge keys, block texts (`|`, `>`) and
complex keys are refused by their place: nothing here can make an object or grow.
Source: YAML 1.0 as OpenCV's FileStorage writes it; YAML 1.2, chapters 6-8.
"""

from __future__ import annotations

import bisect
import math
import re
from itertools import islice
from pathlib import Path

from pseudolidar.errors import CalibrationField, CalibrationSyntax, LimitError
from pseudolidar.formats.rigs.strict_json import (
    DEEPEST,
    EXACT_INTEGER,
    MOST_VALUES,
    JsonNode,
    Value,
    too_many_values,
)
from pseudolidar.formats.text import LONGEST_SHOWN, NUMBER

# The key that OpenCV's JSON has for what is a tag in its YAML and an attribute in its XML.
TYPE_KEY = "type_id"
MATRIX_TYPES = ("opencv-matrix", "opencv-nd-matrix")
_MATRIX_TAGS = {
    form.format(kind): kind for kind in MATRIX_TYPES for form in ("!!{}", "!<tag:yaml.org,2002:{}>")
}
MOST_DOCUMENTS = 100
_INTEGER = re.compile(r"[+-]?(?:0|[1-9][0-9]*)")
_LEADING_ZEROS = re.compile(r"[+-]?0[0-9]")
_CONSTANTS: dict[str, Value] = {"true": True, "false": False, "null": None, "~": None, "": None}
_BLANK = re.compile(r"[ \t]*")
_TAG = re.compile(r"![^\s,\[\]{}]*")
_DOCUMENT = re.compile(r"^(?:---|\.\.\.)(?=[ \t]|$)", re.MULTILINE)
_KEY_START = re.compile(r"[^\s#,\[\]{}&*!|>'\"%@`?-]")
_COLON = re.compile(r":(?=[ \t\n]|\Z)")
_FLOW_KEY = re.compile(r"[^\s#,\[\]{}&*!|>'\"%@`?:][^\n#,\[\]{}:]*")
_PLAIN, _FLOW_PLAIN = re.compile(r"[^\n]*"), re.compile(r"[^\n#,\[\]{}]*")
_COMMENT = re.compile(r"[ \t]#")
_ESCAPE = re.compile(r"\\(x[0-9A-Fa-f]{2}|u[0-9A-Fa-f]{4}|.)", re.DOTALL)
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "0": "\0", '"': '"', "\\": "\\", "/": "/", "'": "'"}
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


def parse_yaml(text: str, path: str | Path) -> tuple[JsonNode, ...]:
    """The documents of `text`, a matrix as a mapping with its `type_id`; `path` names it in errors.

    Raises:
        CalibrationSyntax: not this part of YAML, or too deep; with line and column.
        CalibrationField: a key twice in one mapping, with both lines.
        LimitError: more than 100 000 values in a document, or 100 documents.
    """
    return tuple(_Parser(text, str(path), *span).document() for span in _documents(text, path))


def _documents(text: str, path: str | Path) -> list[tuple[int, int]]:
    """Where each document that is not empty begins and ends."""
    marks = list(islice(_DOCUMENT.finditer(text), MOST_DOCUMENTS + 1))
    if len(marks) > MOST_DOCUMENTS:
        raise LimitError(
            f"more than {MOST_DOCUMENTS} documents", want="a calibration", path=str(path)
        )
    begins = [0, *(mark.end() for mark in marks)]
    ends = [*(mark.start() for mark in marks), len(text)]
    spans = [span for span in zip(begins, ends, strict=True) if _has_content(text[slice(*span)])]
    if not spans:
        raise CalibrationSyntax("nothing in the file", want="KEY: value", path=path)
    return spans


def _has_content(part: str) -> bool:
    lines = (line.strip() for line in part.split("\n"))
    return any(line and line[0] not in "#%" for line in lines)


class _Parser:
    """Recursive descent over one document; positions are character offsets of the whole text."""

    def __init__(self, text: str, path: str, begin: int, end: int) -> None:
        self.text, self.path, self.begin = text[:end], path, begin
        self.lines = [0, *(match.end() for match in re.finditer("\n", self.text))]
        self.values = 0

    # --- places --------------------------------------------------------------------------------

    def line(self, at: int) -> int:
        return bisect.bisect(self.lines, at)

    def column(self, at: int) -> int:
        return at - self.lines[self.line(at) - 1]

    def error(self, at: int, got: str, want: str, name: str = "") -> CalibrationSyntax:
        where = f"line {self.line(at)}, column {self.column(at) + 1}"
        return CalibrationSyntax(
            got, want=want, path=self.path, where=f"{name}, {where}" if name else where
        )

    def node(self, value: Value, at: int, name: str) -> JsonNode:
        self.values += 1
        if self.values > MOST_VALUES:
            raise too_many_values(self.path, f"line {self.line(at)}")
        where = f"line {self.line(at)}, column {self.column(at) + 1}"
        return JsonNode(value, f"{name}, {where}" if name else where, self.path)

    def line_end(self, at: int) -> int:
        """Where the line of `at` ends."""
        end = self.text.find("\n", at)
        return len(self.text) if end < 0 else end

    def found(self, at: int) -> str:
        if at >= len(self.text):
            return "the end of the document"
        return repr(self.text[at : self.line_end(at)][:LONGEST_SHOWN] or "\n")

    def blank(self, at: int) -> int:
        """The next character that is no blank, on the same line."""
        match = _BLANK.match(self.text, at)
        return match.end() if match else at

    def skip(self, at: int) -> int:
        """The next character of content: behind blanks, comments and line ends."""
        while True:
            at = self.blank(at)
            mark = self.text[at : at + 1]
            if mark == "\n":
                at += 1
            elif mark == "#" and (at == 0 or self.text[at - 1] in " \t\n"):
                at = self.line_end(at)
            else:
                return at

    def indented(self, at: int) -> int:
        """Column of content at `at`, which starts its line.

        Tabs may not indent: nobody knows how wide they are.
        """
        start = self.lines[self.line(at) - 1]
        if "\t" in self.text[start:at]:
            raise self.error(self.text.index("\t", start), "a tab before the text", "blanks")
        return at - start

    # --- blocks --------------------------------------------------------------------------------

    def document(self) -> JsonNode:
        at = self.skip(self.begin)
        while self.text[at : at + 1] == "%":  # %YAML:1.0
            at = self.skip(self.line_end(at))
        node, at = self.block(at, "", 0)
        at = self.skip(at)
        if at < len(self.text):
            raise self.error(at, self.found(at), "the end, or a line that is indented as others")
        return node

    def block(self, at: int, name: str, depth: int) -> tuple[JsonNode, int]:
        """The node that starts at `at`, at the beginning of a line or behind `- `."""
        if depth > DEEPEST:
            raise self.error(at, f"more than {DEEPEST} levels deep", "less")
        column = self.column(at)
        if self.is_item(at):
            return self.sequence(at, column, name, depth)
        if self.key(at) is not None:
            return self.mapping(at, column, name, depth)
        return self.on_line(at, name, depth)

    def is_item(self, at: int) -> bool:
        return self.text[at : at + 1] == "-" and self.text[at + 1 : at + 2] in ("", " ", "\t", "\n")

    def sequence(self, start: int, column: int, name: str, depth: int) -> tuple[JsonNode, int]:
        items: list[JsonNode] = []
        at = start
        while at < len(self.text) and self.column(at) == column and self.is_item(at):
            item, at = self.item(at, column, f"{name}[{len(items)}]", depth + 1)
            items.append(item)
            at = self.following(at, column)
        return self.node(tuple(items), start, name), at

    def item(self, dash: int, column: int, name: str, depth: int) -> tuple[JsonNode, int]:
        at = self.blank(dash + 1)
        if self.text[at : at + 1] not in ("", "\n", "#"):
            return self.block(at, name, depth)
        return self.below(at, column, name, depth, same_column=False)

    def mapping(self, start: int, column: int, name: str, depth: int) -> tuple[JsonNode, int]:
        fields: dict[str, JsonNode] = {}
        places: dict[str, int] = {}
        at = start
        while at < len(self.text) and self.column(at) == column:
            found = self.key(at)
            if found is None:
                raise self.error(at, self.found(at), "KEY: value", name)
            key, end = found
            self.once(key, at, places)
            inner = f"{name}.{key}" if name else key
            fields[key], at = self.field(end, column, inner, depth + 1)
            at = self.following(at, column)
        return self.node(fields, start, name), at

    def following(self, at: int, column: int) -> int:
        """Where the next entry of a block of this column stands, or what ends the block."""
        at = self.skip(at)
        if at < len(self.text) and self.indented(at) > column:
            raise self.error(at, "a line that is indented more", f"{column} blanks, or less")
        return at

    def key(self, at: int) -> tuple[str, int] | None:
        """The key at `at` and where its colon ends; None if there is none."""
        if self.text[at : at + 1] in ("'", '"'):
            try:
                key, end = self.quoted(at)
            except CalibrationSyntax:
                return None
            end = self.blank(end)
            is_key = self.text[end : end + 1] == ":"
            return (key, end + 1) if is_key else None
        colon = _COLON.search(self.text, at, self.line_end(at))
        if colon is None or _KEY_START.match(self.text, at) is None:
            return None
        key = self.text[at : colon.start()].rstrip(" \t")
        return None if _COMMENT.search(key) else (key, colon.end())

    def once(self, key: str, at: int, places: dict[str, int]) -> None:
        if key == "<<":
            raise self.error(at, "a merge key", "each key written out")
        if key in places:
            lines = f"lines {self.line(places[key])} and {self.line(at)}"
            raise CalibrationField(
                f"{key!r} twice", want="once", fix="Remove one.", path=self.path, where=lines
            )
        places[key] = at

    def field(self, at: int, column: int, name: str, depth: int) -> tuple[JsonNode, int]:
        """The value behind `KEY:`, on the line or below it."""
        at = self.blank(at)
        tag = _TAG.match(self.text, at)
        if tag is not None and tag[0] in _MATRIX_TAGS:
            node, end = self.field(tag.end(), column, name, depth)
            return self.tagged(node, at, _MATRIX_TAGS[tag[0]]), end
        if self.text[at : at + 1] in ("", "\n", "#"):
            return self.below(at, column, name, depth, same_column=True)
        return self.on_line(at, name, depth)

    def tagged(self, node: JsonNode, at: int, type_id: str) -> JsonNode:
        if not isinstance(node.value, dict):
            raise self.error(at, "a matrix that is no mapping", "rows, cols, dt and data")
        kind = JsonNode(type_id, node.where, node.path)
        return JsonNode({TYPE_KEY: kind, **node.value}, node.where, node.path)

    def below(
        self, at: int, column: int, name: str, depth: int, *, same_column: bool
    ) -> tuple[JsonNode, int]:
        """A block on the lines below, or nothing; `- ` may stand in the column of its key."""
        start = self.skip(at)
        if start < len(self.text):
            own = self.indented(start)
            if own > column or (same_column and own == column and self.is_item(start)):
                return self.block(start, name, depth)
        return self.node(None, at, name), at

    # --- values on a line ----------------------------------------------------------------------

    def on_line(self, at: int, name: str, depth: int) -> tuple[JsonNode, int]:
        """A value behind which its line ends."""
        node, end = self.inline(at, name, depth)
        end = self.blank(end)
        if self.text[end : end + 1] not in ("", "\n", "#"):
            raise self.error(end, self.found(end), "the end of the line", name)
        return node, end

    def inline(self, at: int, name: str, depth: int) -> tuple[JsonNode, int]:
        if depth > DEEPEST:
            raise self.error(at, f"more than {DEEPEST} levels deep", "less")
        match self.text[at : at + 1]:
            case "[":
                return self.flow_sequence(at, name, depth)
            case "{":
                return self.flow_mapping(at, name, depth)
            case '"' | "'":
                text, end = self.quoted(at)
                return self.node(text, at, name), end
        return self.plain(at, name, _PLAIN)

    def plain(self, at: int, name: str, form: re.Pattern[str]) -> tuple[JsonNode, int]:
        mark = self.text[at : at + 1]
        if mark in _REFUSED:
            raise self.error(at, f"{_REFUSED[mark]}, {self.found(at)}", "a plain value", name)
        match = form.match(self.text, at)
        token = _COMMENT.split(match[0], maxsplit=1)[0].rstrip(" \t") if match else ""
        if not token and form is _FLOW_PLAIN:
            raise self.error(at, self.found(at), "a value", name)
        if ": " in token or token.endswith(":"):
            raise self.error(at, self.found(at), "one key a line", name)
        return self.node(_scalar(token), at, name), at + len(token)

    def flow(self, at: int, name: str, depth: int) -> tuple[JsonNode, int]:
        if self.text[at : at + 1] in ("[", "{", "'", '"'):
            return self.inline(at, name, depth)
        return self.plain(at, name, _FLOW_PLAIN)

    def flow_sequence(self, start: int, name: str, depth: int) -> tuple[JsonNode, int]:
        items: list[JsonNode] = []
        at = self.skip(start + 1)
        while self.text[at : at + 1] != "]":
            item, at = self.flow(at, f"{name}[{len(items)}]", depth + 1)
            items.append(item)
            at = self.next_flow(at, "]")
        return self.node(tuple(items), start, name), at + 1

    def flow_mapping(self, start: int, name: str, depth: int) -> tuple[JsonNode, int]:
        fields: dict[str, JsonNode] = {}
        places: dict[str, int] = {}
        at = self.skip(start + 1)
        while self.text[at : at + 1] != "}":
            key, end = self.flow_key(at)
            self.once(key, at, places)
            inner = f"{name}.{key}" if name else key
            fields[key], at = self.flow(self.skip(end), inner, depth + 1)
            at = self.next_flow(at, "}")
        return self.node(fields, start, name), at + 1

    def flow_key(self, at: int) -> tuple[str, int]:
        """A key within braces; OpenCV leaves no blank behind its colon."""
        if self.text[at : at + 1] in ("'", '"'):
            key, end = self.quoted(at)
        else:
            match = _FLOW_KEY.match(self.text, at)
            key = match[0].rstrip(" \t") if match else ""
            end = at + len(key)
        end = self.skip(end)
        if not key or self.text[end : end + 1] != ":":
            raise self.error(at, self.found(at), "KEY: value")
        return key, end + 1

    def next_flow(self, at: int, end: str) -> int:
        """Where the next item or the closing bracket stands."""
        at = self.skip(at)
        mark = self.text[at : at + 1]
        if mark == end:
            return at
        if mark != ",":
            raise self.error(at, self.found(at), f"',' or {end!r}")
        return self.skip(at + 1)

    def quoted(self, at: int) -> tuple[str, int]:
        quote = self.text[at]
        end = at + 1
        while True:
            end = self.text.find(quote, end)
            if end < 0 or "\n" in self.text[at:end]:
                raise self.error(at, "a text without its closing quote", "both on one line")
            inside = self.text[at + 1 : end]
            if quote == "'":
                if self.text[end + 1 : end + 2] != "'":
                    return inside.replace("''", "'"), end + 1
                end += 2
            elif (len(inside) - len(inside.rstrip("\\"))) % 2 == 0:
                return self.unescaped(inside, at + 1), end + 1
            else:
                end += 1

    def unescaped(self, inside: str, start: int) -> str:
        def replaced(match: re.Match[str]) -> str:
            mark = match[1]
            if mark[0] in "xu" and len(mark) > 1:
                return chr(int(mark[1:], 16))
            if mark not in _ESCAPES:
                raise self.error(start + match.start(), f"escape \\{mark}", 'one of \\n \\t \\"')
            return _ESCAPES[mark]

        return _ESCAPE.sub(replaced, inside)


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
