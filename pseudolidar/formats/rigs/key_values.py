"""Text files of `KEY: number number ...` lines, each key once, each with its count of numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pseudolidar.errors import CalibrationField, CalibrationMissing, CalibrationSyntax
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import TextLine, read_lines
from pseudolidar.structures.arrays import Float64

# The colon is optional: KITTI's tracking calibrations leave it out behind some keys.
KEY = re.compile(r"[ \t]*([A-Za-z_][A-Za-z0-9_]*)[ \t]*:?(?=[ \t]|$)")


@dataclass(frozen=True)
class KeyValues:
    """The numbers of a file by key.

    Args:
        path: the file.
        values: (n,) float64 by key.
        lines: line number by key.
        hint: a question that helps to find out what went wrong where a key is missing.
        texts: what stands behind keys that are not those of numbers.
    """

    path: Path
    values: Mapping[str, Float64]
    lines: Mapping[str, int]
    hint: str
    texts: Mapping[str, str] = field(default_factory=dict)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def require(self, key: str) -> Float64:
        """Numbers of `key`.

        Raises:
            CalibrationField: it is missing; the keys that there are are named.
        """
        if key not in self.values:
            raise CalibrationField(
                f"no {key}; found {', '.join(self.lines) or 'no key at all'}",
                want=key,
                fix=self.hint,
                path=self.path,
                where=key,
            )
        return self.values[key]


def read_key_values(
    path: Path, counts: Mapping[str, int], *, hint: str = "", limits: Limits = DEFAULT_LIMITS
) -> KeyValues:
    """Read a file of keyed numbers; what stands behind other keys stays text.

    Args:
        path: the file.
        counts: how many numbers stand behind the keys that match a regular expression.
        hint: see `KeyValues`.
        limits: cap on its size.

    Raises:
        CalibrationMissing: the file is not there.
        CalibrationField: a key stands there twice.
        CalibrationSyntax: a line without a key, a wrong count, or no number.
    """
    values: dict[str, Float64] = {}
    lines: dict[str, int] = {}
    texts: dict[str, str] = {}
    for line in read_lines(
        path, error=CalibrationSyntax, missing=CalibrationMissing, limits=limits
    ):
        if not line.text:
            continue
        key, end = _key_of(line)
        if key in lines:
            raise CalibrationField(
                f"{key} twice, in lines {lines[key]} and {line.number}",
                want="each key once",
                fix="Remove the one that does not belong to this calibration.",
                path=path,
                where=f"line {line.number}",
            )
        lines[key] = line.number
        count = next((n for form, n in counts.items() if re.fullmatch(form, key)), None)
        if count is None:
            texts[key] = line.text[end:].strip(" \t")
        else:
            values[key] = np.array(_numbers(line, key, end, count))
    return KeyValues(path, values, lines, hint, texts)


def _key_of(line: TextLine) -> tuple[str, int]:
    match = KEY.match(line.text)
    if match is None:
        raise line.refusal(
            f"a line that starts with {line.text[:20]!r}", want="KEY: numbers", column=1
        )
    return match[1], match.end()


def _numbers(line: TextLine, key: str, start: int, count: int) -> list[float]:
    words = line.words(start)
    if len(words) != count:
        raise line.refusal(f"{len(words)} numbers for {key}", want=f"{count}")
    return line.numbers(words)


def key_values_text(fields: Mapping[str, Float64 | str]) -> str:
    """`KEY: ...` lines, numbers with all their digits."""
    return "".join(f"{key}: {_written(value)}\n" for key, value in fields.items())


def _written(value: Float64 | str) -> str:
    return value if isinstance(value, str) else " ".join(repr(float(x)) for x in np.ravel(value))
