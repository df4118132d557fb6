"""The part of YAML that calibration files use: strict, and every value knows its line and column.

Block and flow mappings and sequences, plain and quoted scalars, comments, several documents, and
the one tag `!!opencv-matrix`. Anchors, aliases, other tags, merge keys, block texts (`|`, `>`) and
complex keys are refused by their place: nothing here can make an object or grow.
Source: YAML 1.0 as OpenCV's FileStorage writes it; YAML 1.2, chapters 6-8.
"""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path

from pseudolidar.errors import CalibrationSyntax, LimitError
from pseudolidar.formats.rigs.placed import DEEPEST, Node
from pseudolidar.formats.rigs.yaml_flow import FlowValues
from pseudolidar.formats.rigs.yaml_text import YamlText

# The key that OpenCV's JSON has for what is a tag in its YAML and an attribute in its XML.
TYPE_KEY = "type_id"
MATRIX_TYPES = ("opencv-matrix", "opencv-nd-matrix")
_MATRIX_TAGS = {
    form.format(kind): kind for kind in MATRIX_TYPES for form in ("!!{}", "!<tag:yaml.org,2002:{}>")
}
MOST_DOCUMENTS = 100
_TAG = re.compile(r"![^\s,\[\]{}]*")
_DOCUMENT = re.compile(r"^(?:---|\.\.\.)(?=[ \t]|$)", re.MULTILINE)
_KEY_START = re.compile(r"[^\s#,\[\]{}&*!|>'\"%@`?-]")
_COLON = re.compile(r":(?=[ \t\n]|\Z)")
_COMMENT = re.compile(r"[ \t]#")


def parse_yaml(text: str, path: str | Path) -> tuple[Node, ...]:
    """The documents of `text`, a matrix as a mapping with its `type_id`; `path` names it in errors.

    Raises:
        CalibrationSyntax: not this part of YAML, or too deep; with line and column.
        CalibrationField: a key twice in one mapping, with both lines.
        LimitError: more than 100 000 values in a document, or 100 documents.
    """
    return tuple(
        _Blocks(YamlText(text, str(path), *span)).document() for span in _documents(text, path)
    )


def _documents(text: str, path: str | Path) -> list[tuple[int, int]]:
    """Where each document that is not empty begins and ends."""
    marks = list(islice(_DOCUMENT.finditer(text), MOST_DOCUMENTS + 1))
    if len(marks) > MOST_DOCUMENTS:
        raise LimitError(
            f"more than {MOST_DOCUMENTS} documents",
            want="a calibration",
            path=str(path),
            where=f"line {text.count(chr(10), 0, marks[-1].start()) + 1}",
        )
    begins = [0, *(mark.end() for mark in marks)]
    ends = [*(mark.start() for mark in marks), len(text)]
    spans = [span for span in zip(begins, ends, strict=True) if _has_content(text[slice(*span)])]
    if not spans:
        raise CalibrationSyntax("nothing in the file", want="KEY: value", path=path, where="line 1")
    return spans


def _has_content(part: str) -> bool:
    lines = (line.strip() for line in part.split("\n"))
    return any(line and line[0] not in "#%" for line in lines)


class _Blocks:
    """Recursive descent over the blocks of one document."""

    def __init__(self, text: YamlText) -> None:
        self.yaml, self.flow = text, FlowValues(text)

    def document(self) -> Node:
        at = self.yaml.skip(self.yaml.begin)
        while self.yaml[at] == "%":  # %YAML:1.0
            at = self.yaml.skip(self.yaml.line_end(at))
        node, at = self.block(at, "", 0)
        at = self.yaml.skip(at)
        if at < len(self.yaml):
            raise self.yaml.unexpected(at, "the end, or a line that is indented as others")
        return node

    def block(self, at: int, name: str, depth: int) -> tuple[Node, int]:
        """The node that starts at `at`, at the beginning of a line or behind `- `."""
        if depth > DEEPEST:
            raise self.yaml.error(at, f"more than {DEEPEST} levels deep", "less")
        column = self.yaml.column(at)
        if self.is_item(at):
            return self.sequence(at, column, name, depth)
        if self.key(at) is not None:
            return self.mapping(at, column, name, depth)
        return self.on_line(at, name, depth)

    def is_item(self, at: int) -> bool:
        return self.yaml[at] == "-" and self.yaml[at + 1] in ("", " ", "\t", "\n")

    def sequence(self, start: int, column: int, name: str, depth: int) -> tuple[Node, int]:
        items: list[Node] = []
        at = start
        while at < len(self.yaml) and self.yaml.column(at) == column and self.is_item(at):
            item, at = self.item(at, column, f"{name}[{len(items)}]", depth + 1)
            items.append(item)
            at = self.following(at, column)
        return self.yaml.node(tuple(items), start, name), at

    def item(self, dash: int, column: int, name: str, depth: int) -> tuple[Node, int]:
        at = self.yaml.blank(dash + 1)
        if self.yaml[at] not in ("", "\n", "#"):
            return self.block(at, name, depth)
        return self.below(at, column, name, depth, same_column=False)

    def mapping(self, start: int, column: int, name: str, depth: int) -> tuple[Node, int]:
        fields: dict[str, Node] = {}
        places: dict[str, int] = {}
        at = start
        while at < len(self.yaml) and self.yaml.column(at) == column:
            found = self.key(at)
            if found is None:
                raise self.yaml.unexpected(at, "KEY: value", name)
            key, end = found
            self.yaml.once(key, at, places)
            inner = f"{name}.{key}" if name else key
            fields[key], at = self.field(end, column, inner, depth + 1)
            at = self.following(at, column)
        return self.yaml.node(fields, start, name), at

    def following(self, at: int, column: int) -> int:
        """Where the next entry of a block of this column stands, or what ends the block."""
        at = self.yaml.skip(at)
        if at < len(self.yaml) and self.yaml.indented(at) > column:
            raise self.yaml.error(at, "a line that is indented more", f"{column} blanks, or less")
        return at

    def key(self, at: int) -> tuple[str, int] | None:
        """The key at `at` and where its colon ends; None if there is none."""
        if self.yaml[at] in ("'", '"'):
            try:
                key, end = self.yaml.quoted(at)
            except CalibrationSyntax:
                return None
            end = self.yaml.blank(end)
            is_key = self.yaml[end] == ":"
            return (key, end + 1) if is_key else None
        colon = _COLON.search(self.yaml.text, at, self.yaml.line_end(at))
        if colon is None or _KEY_START.match(self.yaml.text, at) is None:
            return None
        key = self.yaml.text[at : colon.start()].rstrip(" \t")
        return None if _COMMENT.search(key) else (key, colon.end())

    def field(self, at: int, column: int, name: str, depth: int) -> tuple[Node, int]:
        """The value behind `KEY:`, on the line or below it."""
        at = self.yaml.blank(at)
        tag = _TAG.match(self.yaml.text, at)
        if tag is not None and tag[0] in _MATRIX_TAGS:
            node, end = self.field(tag.end(), column, name, depth)
            return self.tagged(node, at, _MATRIX_TAGS[tag[0]]), end
        if self.yaml[at] in ("", "\n", "#"):
            return self.below(at, column, name, depth, same_column=True)
        return self.on_line(at, name, depth)

    def tagged(self, node: Node, at: int, type_id: str) -> Node:
        if not isinstance(node.value, dict):
            raise self.yaml.error(at, "a matrix that is no mapping", "rows, cols, dt and data")
        kind = Node(type_id, node.where, node.path)
        return Node({TYPE_KEY: kind, **node.value}, node.where, node.path)

    def below(
        self, at: int, column: int, name: str, depth: int, *, same_column: bool
    ) -> tuple[Node, int]:
        """A block on the lines below, or nothing; `- ` may stand in the column of its key."""
        start = self.yaml.skip(at)
        if start < len(self.yaml):
            own = self.yaml.indented(start)
            if own > column or (same_column and own == column and self.is_item(start)):
                return self.block(start, name, depth)
        return self.yaml.node(None, at, name), at

    def on_line(self, at: int, name: str, depth: int) -> tuple[Node, int]:
        """A value behind which its line ends."""
        node, end = self.flow.inline(at, name, depth)
        end = self.yaml.blank(end)
        if self.yaml[end] not in ("", "\n", "#"):
            raise self.yaml.unexpected(end, "the end of the line", name)
        return node, end
