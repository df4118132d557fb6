"""Plain-text input under a strict grammar: what is not clearly a number is refused by its place."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import LimitError, PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.formats.whole_read import read_whole

# Unlike `float()`: no 1_000, nan, infinity, decimal comma or digits of other scripts.
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
WORD = re.compile(r"[^ \t]+")
LONGEST_SHOWN = 40


@dataclass(frozen=True)
class Word:
    """A run of non-blank characters and the column (from 1) where it starts."""

    text: str
    column: int


@dataclass(frozen=True)
class TextLine:
    """One line of a file.

    Args:
        path: the file.
        number: line number, from 1.
        text: the line without its end and trailing blanks.
        error: what to raise where it is not legal.
    """

    path: Path
    number: int
    text: str
    error: type[PseudolidarError]

    def words(self, start: int = 0) -> list[Word]:
        """Words from character `start` on."""
        return [Word(m[0], m.start() + 1) for m in WORD.finditer(self.text, start)]

    def numbers(self, words: list[Word], *, count: int | None = None) -> list[float]:
        """The words as finite numbers.

        Raises:
            PseudolidarError: of kind `error`, with line and column; `count` is not met.
        """
        if count is not None and len(words) != count:
            raise self.refusal(f"{len(words)} numbers", want=f"{count}")
        return [self.number_of(word) for word in words]

    def number_of(self, word: Word) -> float:
        """One word as a finite number.

        Raises:
            PseudolidarError: of kind `error`, with line and column.
        """
        value = float(word.text) if NUMBER.fullmatch(word.text) else math.nan
        if not math.isfinite(value):
            raise self.refusal(
                f"{word.text[:LONGEST_SHOWN]!r}",
                want="a finite decimal number such as -1.5e-3",
                column=word.column,
            )
        return value

    def refusal(
        self, got: str, *, want: str = "", fix: str = "", column: int | None = None
    ) -> PseudolidarError:
        """The error to raise about this line."""
        where = f"line {self.number}" + ("" if column is None else f", column {column}")
        return self.error(got, want=want, fix=fix, path=self.path, where=where)


def read_lines(
    path: Path,
    *,
    error: type[PseudolidarError],
    missing: type[PseudolidarError] | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> list[TextLine]:
    """Lines of a text file; byte-order mark, CR LF, trailing blanks and blank lines are harmless.

    Args:
        path: file of UTF-8 or Latin-1 text.
        error: what to raise where the file is not legal.
        missing: what to raise where it is not there, if another kind than `error`.
        limits: cap on its size.

    Raises:
        LimitError: larger than `limits.text_bytes`, more lines than `limits.text_lines`.
        PseudolidarError: of kind `missing` or `error`.
    """
    try:
        if path.stat().st_size > limits.text_bytes:
            raise LimitError(
                f"{path.stat().st_size} bytes",
                want=f"at most {limits.text_bytes}",
                fix=raise_cap("text_bytes"),
                path=path,
            )
        data = read_whole(path)
    except OSError as fault:
        raise (missing or error)(fault.strerror or str(fault), want="a file", path=path) from fault
    text = _decode(path, data, error).replace("\r\n", "\n").replace("\r", "\n")
    if text.count("\n") > limits.text_lines:
        raise LimitError(
            f"{text.count(chr(10))} lines",
            want=f"at most {limits.text_lines}",
            fix=raise_cap("text_lines"),
            path=path,
        )
    return list(_numbered(path, text, error))


def _numbered(path: Path, text: str, error: type[PseudolidarError]) -> Iterator[TextLine]:
    lines = text.split("\n")
    while lines and not lines[-1].strip(" \t"):
        lines.pop()
    for number, line in enumerate(lines, start=1):
        yield TextLine(path, number, line.rstrip(" \t"), error)


def _decode(path: Path, data: bytes, error: type[PseudolidarError]) -> str:
    nul = data.find(b"\0")
    if nul >= 0:
        raise error(
            "a zero byte",
            want="plain text",
            fix="Save the file as UTF-8 if it is UTF-16.",
            path=path,
            where=f"byte {nul}",
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")
