"""The characters of a YAML document: blanks, comments, quoted texts, and the place of each."""

from __future__ import annotations

import re

from pseudolidar.errors import CalibrationSyntax
from pseudolidar.formats.rigs.placed import Node, Places, Value
from pseudolidar.formats.text import LONGEST_SHOWN

_BLANK = re.compile(r"[ \t]*")
_ESCAPE = re.compile(r"\\(x[0-9A-Fa-f]{2}|u[0-9A-Fa-f]{4}|.)", re.DOTALL)
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "0": "\0", '"': '"', "\\": "\\", "/": "/", "'": "'"}


class YamlText:
    """A document within a file; positions are character offsets of the whole file.

    Args:
        text: the file.
        path: names it in errors.
        begin: where the document begins.
        end: where it ends.
    """

    def __init__(self, text: str, path: str, begin: int, end: int) -> None:
        self.text, self.begin = text[:end], begin
        self.places = Places(self.text, path)

    def __getitem__(self, at: int) -> str:
        """The character at `at`, "" behind the end."""
        return self.text[at : at + 1]

    def __len__(self) -> int:
        """Where the document ends."""
        return len(self.text)

    def node(self, value: Value, at: int, name: str) -> Node:
        """A value that stands at `at`."""
        self.places.count(at)
        where = self.places.told(at)
        return Node(value, f"{name}, {where}" if name else where, self.places.path)

    def line_end(self, at: int) -> int:
        """Where the line of `at` ends."""
        end = self.text.find("\n", at)
        return len(self.text) if end < 0 else end

    def column(self, at: int) -> int:
        """Characters of the line before `at`."""
        return self.places.column(at)

    def error(self, at: int, got: str, want: str, name: str = "") -> CalibrationSyntax:
        """What to raise about `at`, within the value called `name`."""
        return self.places.error(at, got, want, name)

    def unexpected(self, at: int, want: str, name: str = "") -> CalibrationSyntax:
        """What to raise where the text at `at` is not what is wanted."""
        return self.error(at, self.found(at), want, name)

    def found(self, at: int) -> str:
        """The rest of the line at `at`, in short."""
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
        start = self.places.start(at)
        if "\t" in self.text[start:at]:
            raise self.error(self.text.index("\t", start), "a tab before the text", "blanks")
        return at - start

    def once(self, key: str, at: int, places: dict[str, int]) -> None:
        """Note where a key of a mapping stands.

        Raises:
            CalibrationField: `places` has it already.
            CalibrationSyntax: a merge key.
        """
        if key == "<<":
            raise self.error(at, "a merge key", "each key written out")
        if key in places:
            raise self.places.twice(key, places[key], at)
        places[key] = at

    def quoted(self, at: int) -> tuple[str, int]:
        """The text whose opening quote is at `at`, and where it ends."""
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
                return self._unescaped(inside, at + 1), end + 1
            else:
                end += 1

    def _unescaped(self, inside: str, start: int) -> str:
        def replaced(match: re.Match[str]) -> str:
            mark = match[1]
            if mark[0] in "xu" and len(mark) > 1:
                return chr(int(mark[1:], 16))
            if mark not in _ESCAPES:
                raise self.error(start + match.start(), f"escape \\{mark}", 'one of \\n \\t \\"')
            return _ESCAPES[mark]

        return _ESCAPE.sub(replaced, inside)
