"""Files of times as users have them: one time a line, or a time and a picture's name.

Known forms: seconds (`times.txt`), dates (`timestamps.txt` of KITTI raw), whole numbers of ms, us
or ns, and lists of time and name as EuRoC (`data.csv`) and TUM (`rgb.txt`) write them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from pseudolidar.errors import SequenceTime
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import NUMBER, TextLine, Word, read_lines
from pseudolidar.formats.timestamps import DATE, LARGEST_S, NS_PER_S, date_ns

# Whole numbers of so many digits may be times of day; each with the length of its unit, ns.
UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": NS_PER_S}
UNIT_WORDS = {
    "s": "seconds",
    "ms": "milliseconds",
    "us": "microseconds",
    "ns": "nanoseconds",
    "dates": "dates in UTC",
}
# Times of day that a recording may have, s since 1970: the years 2000 to 2100.
EARLIEST_S, LATEST_S = 946_684_800, 4_102_444_800
# Whole numbers that count from the start are seconds, or nanoseconds where frames would be further
# apart than this, s; and then they may not be nearer than this.
LARGEST_STEP_S, SMALLEST_STEP_NS = 1_000, 100_000
_SEPARATOR = re.compile(r"[ \t]*[,;][ \t]*|[ \t]+")
_HEADING = re.compile(r"[#\"'A-Za-z]")


@dataclass(frozen=True)
class TimeTable:
    """What a file of times says.

    Args:
        path: the file.
        stamps_ns: by entry; None for a blank line, which may hold the place of a missing frame.
        names: of the picture of each entry, None where the file names none.
        lines: line number of each entry.
        unit: what the numbers were taken for.
    """

    path: Path
    stamps_ns: tuple[int | None, ...]
    names: tuple[str, ...] | None
    lines: tuple[int, ...]
    unit: str

    @property
    def note(self) -> str:
        """What was read, for people."""
        named = "" if self.names is None else ", by the names of the pictures"
        return f"time: of {self.path.name}, {UNIT_WORDS[self.unit]}{named}"


@dataclass(frozen=True)
class _Entry:
    """A line that is no comment: its time as written, and the rest."""

    line: TextLine
    time: Word | None
    name: str


def read_time_table(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> TimeTable:
    """Read a file of times; comments (#) and a heading line are passed over.

    Raises:
        SequenceTime: no such file, or a line that is none of this, by its number.
    """
    lines = read_lines(path, error=SequenceTime, limits=limits)
    entries = [entry for line in lines if (entry := _entry(line, first=line.number == 1))]
    filled = [entry for entry in entries if entry.time is not None]
    if not filled:
        raise SequenceTime("no time", want="a time by line", path=path)
    named = bool(filled[0].name)
    for entry in filled:
        if bool(entry.name) != named:
            raise entry.line.refusal(
                f"{entry.line.text[:40]!r}",
                want="a time and a name, as above" if named else "a time alone, as above",
            )
    dated = DATE.match(filled[0].line.text.strip(" \t\"'")) is not None
    stamps, unit = _dates(filled) if dated else _numbers(filled)
    if named:
        names = tuple(entry.name for entry in filled)
        return TimeTable(path, stamps, names, tuple(e.line.number for e in filled), unit)
    found = iter(stamps)
    placed = tuple(None if entry.time is None else next(found) for entry in entries)
    return TimeTable(path, placed, None, tuple(e.line.number for e in entries), unit)


def _entry(line: TextLine, *, first: bool) -> _Entry | None:
    text = line.text.strip(" \t")
    if not text:
        return _Entry(line, None, "")
    if text.startswith("#"):
        return None
    start = line.text.index(text) + 1
    date = DATE.match(text)
    if date is not None:
        rest = text[date.end() :]
        return _Entry(line, Word(date[0], start), _SEPARATOR.sub("", rest, count=1))
    parts = [part.strip("\"'") for part in _SEPARATOR.split(text)]
    numeric = [NUMBER.fullmatch(part) is not None for part in parts]
    if first and not any(numeric) and _HEADING.match(text):
        return None
    if numeric == [True]:
        return _Entry(line, Word(parts[0], start), "")
    if len(parts) in (2, 4) and numeric[0] and not numeric[1]:  # 4: what TUM's associate.py writes
        return _Entry(line, Word(parts[0], start), parts[1])
    if len(parts) == 2 and numeric == [False, True]:
        return _Entry(line, Word(parts[1], start + text.index(parts[1])), parts[0])
    raise line.refusal(
        f"{text[:40]!r}",
        want="a time (seconds, a date, nanoseconds), or a time and the name of a picture",
    )


def _dates(entries: Sequence[_Entry]) -> tuple[tuple[int, ...], str]:
    return tuple(date_ns(entry.line, entry.time.text) for entry in entries if entry.time), "dates"


def _numbers(entries: Sequence[_Entry]) -> tuple[tuple[int, ...], str]:
    values = []
    for entry in entries:
        assert entry.time is not None
        entry.line.number_of(entry.time)
        values.append(Decimal(entry.time.text))
    unit = _unit(values, entries[0].line)
    stamps = []
    for entry, value in zip(entries, values, strict=True):
        # The exponent first: a number of a billion digits must not be written out.
        fits = value.adjusted() < len(str(2**63)) and 0 <= value * UNITS_NS[unit] < 2**63
        if not fits:
            raise entry.line.refusal(
                f"{str(value)[:40]!r} {unit}",
                want=f"a time from 0 to {LARGEST_S} s",
            )
        stamps.append(int((value * UNITS_NS[unit]).to_integral_value()))
    return tuple(stamps), unit


def _unit(values: Sequence[Decimal], line: TextLine) -> str:
    """What one unit is: by the day that it would be, else by the distance of frames."""
    whole = all(
        value.is_finite() and value.adjusted() < 19 and value == int(value) for value in values
    )
    if not whole:
        return "s"
    first, last = int(values[0]), int(values[-1])
    for unit, unit_ns in UNITS_NS.items():
        if all(EARLIEST_S <= time * unit_ns / NS_PER_S <= LATEST_S for time in (first, last)):
            return unit
    steps = np.diff(np.array([float(value) for value in values]))
    step = float(np.median(steps)) if len(steps) else 0.0
    if step < LARGEST_STEP_S:
        return "s"
    if step < SMALLEST_STEP_NS:
        raise line.refusal(
            f"frames {step:g} apart, which can be neither seconds nor nanoseconds",
            want="seconds, or whole nanoseconds",
            fix="Write the times in seconds.",
        )
    return "ns"
