"""Time stamp files of sequences: dates to the nanosecond (KITTI raw) and seconds (`times.txt`).

Times are int nanoseconds, dates are read as UTC; nothing passes through floating point.
"""

from __future__ import annotations

import calendar
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path

from pseudolidar.errors import SequenceTime
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import TextLine, read_lines

NS_PER_S = 1_000_000_000
DATE = re.compile(
    r"([0-9]{4})-([0-9]{2})-([0-9]{2})[ T]([0-9]{2}):([0-9]{2}):([0-9]{2})(?:\.([0-9]{1,9}))?"
)
# 292 years: what fits in int64 nanoseconds.
LARGEST_S = 2**63 // NS_PER_S


def read_timestamps(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[int | None, ...]:
    """Read `timestamps.txt` of KITTI raw: one date a line, int ns since 1970 UTC.

    Returns:
        A stamp by line; None for a blank one, which holds the place of a frame that is missing.

    Raises:
        SequenceTime: missing file, or a line that is no date.
    """
    lines = read_lines(path, error=SequenceTime, limits=limits)
    return tuple(date_ns(line, line.text.strip(" \t")) if line.text else None for line in lines)


def date_ns(line: TextLine, text: str) -> int:
    """The date `text` of a line, ns since 1970 UTC.

    Raises:
        SequenceTime: it is no date, or not one of 1970 to 2261.
    """
    match = DATE.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        date = datetime(*(int(part) for part in match.groups()[:6]), tzinfo=UTC)  # type: ignore[arg-type,misc]
        seconds = calendar.timegm(date.utctimetuple())
        if not 0 <= seconds < LARGEST_S:
            raise ValueError
    except ValueError:
        raise line.refusal(
            f"{line.text[:40]!r}", want="a date such as 2011-09-26 13:02:44.327963904, 1970 to 2261"
        ) from None
    return seconds * NS_PER_S + int((match[7] or "").ljust(9, "0"))


def write_timestamps(path: Path, timestamps_ns: Sequence[int]) -> None:
    """Write `timestamps.txt` of KITTI raw, exact to the nanosecond."""
    write_atomic(path, "".join(f"{_date(stamp)}\n" for stamp in timestamps_ns).encode())


def _date(timestamp_ns: int) -> str:
    seconds, ns = divmod(int(timestamp_ns), NS_PER_S)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{ns:09d}"


def read_times(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[int, ...]:
    """Read `times.txt` of KITTI odometry: seconds by line, to int ns.

    Raises:
        SequenceTime: missing file, a line that is not one number, or a negative one.
    """
    lines = read_lines(path, error=SequenceTime, limits=limits)
    return tuple(_seconds_ns(line) for line in lines if line.text)


def _seconds_ns(line: TextLine) -> int:
    words = line.words()
    (seconds,) = line.numbers(words, count=1)
    try:
        if not 0 <= seconds < LARGEST_S:
            raise ValueError
        return int((Decimal(words[0].text) * NS_PER_S).to_integral_value())
    except (ValueError, InvalidOperation):  # the latter: an exponent of twenty digits
        raise line.refusal(
            f"{words[0].text[:40]!r} s", want="seconds from the start of the sequence"
        ) from None


def write_times(path: Path, timestamps_ns: Sequence[int]) -> None:
    """Write `times.txt` of KITTI odometry, exact to the nanosecond."""
    lines = [
        f"{ns // NS_PER_S}.{ns % NS_PER_S:09d}\n" for ns in (int(stamp) for stamp in timestamps_ns)
    ]
    write_atomic(path, "".join(lines).encode())
