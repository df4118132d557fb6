"""Projection matrices in text files: twelve numbers each, with or without a name and brackets.

`p_left = [[640, 0, 640, 2176], [...], [...]]`, MATLAB's `P1 = [1 2 3 4; ...]`, three lines of four
numbers, one line of twelve. Nothing is evaluated.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import CalibrationField, CalibrationMissing, CalibrationSyntax
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import TextLine, Word, read_lines
from pseudolidar.structures.arrays import Float64

ROWS, COLUMNS = 3, 4
# A pair; a file with more is none of this form.
MOST_MATRICES = 2
# What may stand between and around the numbers of a matrix.
_PUNCTUATION = "[](){},; \t"
_NAME = re.compile(r"[ \t]*([A-Za-z_]\w*)[ \t]*[=:][ \t]*(?:(?:np|numpy)\.(?:array|matrix))?")
_TOKEN = re.compile(r"[^\[\](){},; \t]+")
# What a matrix begins with; without a name before it, it is not the [NAME] of an INI file.
_BRACKET = re.compile(r"[ \t]*[\[(]")
_BRACKETED_NUMBER = re.compile(r"[ \t]*[\[(][\[( \t]*(?:[-+.0-9]|$)")
_COMMENT = re.compile(r"[#%].*|//.*")


@dataclass(frozen=True, eq=False)
class NamedMatrix:
    """A projection matrix as a file has it.

    Args:
        path: the file.
        name: what the file calls it, empty where it has no name.
        P: (3, 4) float64.
        line: where it begins, from 1.
    """

    path: Path
    name: str
    P: Float64
    line: int

    @property
    def where(self) -> str:
        """The place, for errors."""
        return f"{self.name}, line {self.line}" if self.name else f"line {self.line}"


def read_projections(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[NamedMatrix, ...]:
    """The projection matrices of a file, one or two.

    Raises:
        CalibrationMissing: no such file.
        CalibrationSyntax: what is no number, another count of them; by line and column.
        CalibrationField: a name twice, or no matrix at all.
        LimitError: larger than the cap.
    """
    lines = read_lines(path, error=CalibrationSyntax, missing=CalibrationMissing, limits=limits)
    found: list[_Growing] = []
    for line in lines:
        text = _COMMENT.sub("", line.text)
        if not text.strip(" \t"):
            continue
        named = _NAME.match(text)
        if named is not None or not found or found[-1].full:
            _check_full(found)
            found.append(_Growing(named[1] if named else "", line))
            if len(found) > MOST_MATRICES:
                raise line.refusal(
                    "a third matrix",
                    want=f"{MOST_MATRICES} projection matrices of {ROWS}x{COLUMNS}",
                )
        start = named.end() if named else 0
        found[-1].take(line, [Word(m[0], m.start() + 1) for m in _TOKEN.finditer(text, start)])
    _check_full(found)
    if not found:
        raise CalibrationField("no matrix", want=f"projection matrices of {ROWS}x{COLUMNS}",
                               path=path)  # fmt: skip
    if len(found) == MOST_MATRICES and found[0].name and found[0].name == found[1].name:
        raise CalibrationField(
            f"{found[0].name} twice, in lines {found[0].line.number} and {found[1].line.number}",
            want="each name once",
            path=path,
            where=f"line {found[1].line.number}",
        )
    return tuple(matrix.done() for matrix in found)


def looks_like_projections(lines: Sequence[str]) -> bool:
    """Whether lines of text (those that are not empty) are of this form.

    That is: a matrix in brackets, or rows of four numbers. Middlebury's files begin alike.
    """
    bare = [_COMMENT.sub("", line) for line in lines[: 4 * ROWS]]
    bare = [line for line in bare if line.strip(" \t")]
    if not bare:
        return False
    named = _NAME.match(bare[0])
    rest = bare[0][named.end() :] if named else bare[0]
    if (_BRACKET if named else _BRACKETED_NUMBER).match(rest):
        return True
    return named is None and all(len(_TOKEN.findall(line)) == COLUMNS for line in bare[:ROWS])


class _Growing:
    """A matrix whose numbers are read line by line."""

    def __init__(self, name: str, line: TextLine) -> None:
        self.name, self.line = name, line
        self.numbers: list[float] = []

    @property
    def full(self) -> bool:
        return len(self.numbers) == ROWS * COLUMNS

    def take(self, line: TextLine, words: list[Word]) -> None:
        """The numbers of a line: whole rows of the matrix."""
        if len(words) % COLUMNS:
            raise line.refusal(
                f"{len(words)} numbers{self._of}",
                want=f"rows of {COLUMNS}: a projection matrix is {ROWS}x{COLUMNS}",
            )
        self.numbers += line.numbers(words)
        if len(self.numbers) > ROWS * COLUMNS:
            raise line.refusal(f"{len(self.numbers)} numbers{self._of}", want=f"{ROWS * COLUMNS}")

    def done(self) -> NamedMatrix:
        P = np.array(self.numbers, dtype=np.float64).reshape(ROWS, COLUMNS)
        return NamedMatrix(self.line.path, self.name, P, self.line.number)

    @property
    def _of(self) -> str:
        return f" of {self.name}" if self.name else ""


def _check_full(found: list[_Growing]) -> None:
    if found and not found[-1].full:
        raise found[-1].line.refusal(
            f"{len(found[-1].numbers)} numbers{found[-1]._of}", want=f"{ROWS * COLUMNS}"
        )
