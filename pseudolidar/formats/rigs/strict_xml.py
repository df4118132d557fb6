"""The part of XML that OpenCV's FileStorage writes: elements, `type_id`, text, comments.

A document type, entities of one's own, processing instructions and CDATA are refused by their
place, so that nothing is fetched and nothing grows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from pseudolidar.formats.rigs.placed import DEEPEST, EXACT_INTEGER, Node, Places, Value
from pseudolidar.formats.rigs.strict_yaml import TYPE_KEY
from pseudolidar.formats.text import LONGEST_SHOWN, NUMBER

ROOT = "opencv_storage"
ITEM = "_"  # name of the elements of a sequence
_PROLOG = re.compile(r"\s*<\?xml\s[^<>?]*\?>")
_OPEN = re.compile(r"<([A-Za-z_][\w.-]*)((?:\s+[A-Za-z_][\w.-]*\s*=\s*\"[^\"<&]*\")*)\s*(/?)>")
_CLOSE = re.compile(r"</([A-Za-z_][\w.-]*)\s*>")
_ATTRIBUTE = re.compile(r"([A-Za-z_][\w.-]*)\s*=\s*\"([^\"]*)\"")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_WORD = re.compile(r'"[^"]*"|[^\s"<]+')
_ENTITY = re.compile(r"&([^;\s]{0,20});?")
_ENTITIES = {"lt": "<", "gt": ">", "amp": "&", "quot": '"', "apos": "'"}
_WHOLE = re.compile(r"[+-]?[0-9]+")


@dataclass
class _Element:
    """An element that is being read."""

    name: str
    at: int
    type_id: str | None
    children: list[tuple[str, Node, int]] = field(default_factory=list)
    words: list[tuple[str, int]] = field(default_factory=list)


def parse_xml(text: str, path: str | Path) -> Node:
    """The tree below `<opencv_storage>`, a matrix as a mapping with its `type_id`.

    Raises:
        CalibrationSyntax: not this part of XML, or too deep; with line and column.
        CalibrationField: a key twice in one element, with both lines.
        LimitError: more than 100 000 values.
    """
    return _Parser(text, str(path)).document()


class _Parser:
    """One pass over the text with a stack of open elements."""

    def __init__(self, text: str, path: str) -> None:
        self.text, self.places = text, Places(text, path)

    def document(self) -> Node:
        prolog = _PROLOG.match(self.text)
        at = self.space(prolog.end() if prolog else 0)
        stack: list[_Element] = []
        while True:
            if self.text.startswith("</", at):
                at = self.closed(at, stack)
                if len(stack) == 1 and stack[0].name == "":
                    break
            elif self.text.startswith("<", at):
                at = self.opened(at, stack)
            else:
                at = self.worded(at, stack)
            at = self.space(at)
        if self.space(at) < len(self.text):
            raise self.places.error(
                self.space(at), "text behind the last element", "the end of the file"
            )
        ((name, node, start),) = stack[0].children
        if name != ROOT:
            raise self.places.error(start, f"<{name}>", f"<{ROOT}>")
        return node

    def space(self, at: int) -> int:
        """Behind blanks and comments."""
        while True:
            while self.text[at : at + 1] in (" ", "\t", "\n", "\r") and at < len(self.text):
                at += 1
            if not self.text.startswith("<!--", at):
                return at
            match = _COMMENT.match(self.text, at)
            if match is None:
                raise self.places.error(at, "a comment without its end", "-->")
            at = match.end()

    def opened(self, at: int, stack: list[_Element]) -> int:
        match = _OPEN.match(self.text, at)
        if match is None:
            raise self.places.error(at, repr(self.text[at : at + LONGEST_SHOWN]), "an element")
        if not stack:
            stack.append(_Element("", at, None))
        if len(stack) > DEEPEST + 1:
            raise self.places.error(at, f"more than {DEEPEST} levels deep", "less")
        attributes = dict(_ATTRIBUTE.findall(match[2]))
        self.places.count(at)
        stack.append(_Element(match[1], at, attributes.get(TYPE_KEY)))
        if match[3]:
            self.finish(stack)
        return match.end()

    def closed(self, at: int, stack: list[_Element]) -> int:
        match = _CLOSE.match(self.text, at)
        name = stack[-1].name if stack else ""
        if match is None or match[1] != name or not name:
            found = repr(self.text[at : at + LONGEST_SHOWN])
            raise self.places.error(at, found, f"</{name}>" if name else "an element")
        self.finish(stack)
        return match.end()

    def finish(self, stack: list[_Element]) -> None:
        element = stack.pop()
        names = [e.name for e in stack[2:]] + [element.name]
        stack[-1].children.append((element.name, self.node(element, ".".join(names)), element.at))

    def worded(self, at: int, stack: list[_Element]) -> int:
        match = _WORD.match(self.text, at)
        if not stack or match is None:
            found = repr(self.text[at : at + LONGEST_SHOWN]) if at < len(self.text) else "the end"
            raise self.places.error(at, found, f"</{stack[-1].name}>" if stack else f"<{ROOT}>")
        word = match[0]
        self.places.count(at)
        stack[-1].words.append((word, at))
        return at + len(word)

    # --- elements to values --------------------------------------------------------------------

    def node(self, element: _Element, name: str) -> Node:
        where = f"{name}, {self.places.told(element.at)}"
        if element.children and element.words:
            raise self.places.error(element.words[0][1], "text beside elements", "one of the two")
        if not element.children:
            return self.words_node(element, name, where)
        names = {child for child, _, _ in element.children}
        if names == {ITEM}:
            return Node(tuple(node for _, node, _ in element.children), where, self.places.path)
        return Node(self.fields(element, where), where, self.places.path)

    def fields(self, element: _Element, where: str) -> dict[str, Node]:
        found: dict[str, Node] = {}
        if element.type_id is not None:
            found[TYPE_KEY] = Node(element.type_id, where, self.places.path)
        places: dict[str, int] = {}
        for name, node, at in element.children:
            if name in places:
                raise self.places.twice(name, places[name], at)
            places[name], found[name] = at, node
        return found

    def words_node(self, element: _Element, name: str, where: str) -> Node:
        nodes = tuple(
            Node(self.scalar(word, at), f"{name}, {self.places.told(at)}", self.places.path)
            for word, at in element.words
        )
        if not nodes:
            return Node(None, where, self.places.path)
        return nodes[0] if len(nodes) == 1 else Node(nodes, where, self.places.path)

    def scalar(self, word: str, at: int) -> Value:
        if word.startswith('"') and len(word) > 1:
            return self.unescaped(word[1:-1], at)
        if not NUMBER.fullmatch(word):
            return self.unescaped(word, at)
        value = float(word)
        whole = _WHOLE.fullmatch(word) and abs(value) <= EXACT_INTEGER
        return int(word) if whole else value

    def unescaped(self, word: str, at: int) -> str:
        def replaced(match: re.Match[str]) -> str:
            if match[1] not in _ENTITIES or not match[0].endswith(";"):
                raise self.places.error(
                    at, f"entity {match[0]!r}", "one of &lt; &gt; &amp; &quot; &apos;"
                )
            return _ENTITIES[match[1]]

        return _ENTITY.sub(replaced, word)
