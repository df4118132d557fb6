"""Values of calibration files with their places, and how places are told in errors."""

from __future__ import annotations

import bisect
import re
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import CalibrationField, CalibrationSyntax, CalibrationValue, LimitError

DEEPEST = 32
# Values of a file: a calibration with the corners of all its pictures has some thousands, and each
# value takes some 300 bytes of memory.
MOST_VALUES = 100_000
# Integers up to here are exact in the float64 of other readers.
EXACT_INTEGER = 2**53

Value = str | int | float | bool | None | tuple["Node", ...] | dict[str, "Node"]


@dataclass(frozen=True)
class Node:
    """A value with its place.

    Args:
        value: a scalar, a tuple of nodes, or a dict of nodes.
        where: path within the file and line ("left.K[0], line 4").
        path: the file.
    """

    value: Value
    where: str
    path: str


def at_place(error: CalibrationValue, *, path: str | Path, where: str) -> CalibrationValue:
    """The error of a noun, with the file and the place that its value came from."""
    return CalibrationValue(error.got, want=error.want, fix=error.fix, path=path, where=where)


class Places:
    """Character offsets of a text as lines and columns, and how many values it has had.

    Args:
        text: the file, or its beginning.
        path: names it in errors.
    """

    def __init__(self, text: str, path: str) -> None:
        self.path = path
        self._starts = [0, *(match.end() for match in re.finditer("\n", text))]
        self._values = 0

    def line(self, at: int) -> int:
        """Number of the line, from 1."""
        return bisect.bisect(self._starts, at)

    def start(self, at: int) -> int:
        """Where the line of `at` begins."""
        return self._starts[self.line(at) - 1]

    def column(self, at: int) -> int:
        """Characters of the line before `at`."""
        return at - self.start(at)

    def told(self, at: int) -> str:
        """Line and column for people, from 1."""
        return f"line {self.line(at)}, column {self.column(at) + 1}"

    def count(self, at: int) -> None:
        """One more value.

        Raises:
            LimitError: that is more than any calibration has.
        """
        self._values += 1
        if self._values > MOST_VALUES:
            raise LimitError(
                f"more than {MOST_VALUES} values",
                want="a calibration",
                path=self.path,
                where=self.told(at),
            )

    def error(self, at: int, got: str, want: str, name: str = "") -> CalibrationSyntax:
        """What to raise about `at`, within the value called `name`."""
        where = f"{name}, {self.told(at)}" if name else self.told(at)
        return CalibrationSyntax(got, want=want, path=self.path, where=where)

    def twice(self, key: str, first: int, again: int) -> CalibrationField:
        """What to raise about a key at two places of one mapping."""
        lines = f"lines {self.line(first)} and {self.line(again)}"
        return CalibrationField(
            f"{key!r} twice", want="once", fix="Remove one.", path=self.path, where=lines
        )
