"""Names of pictures: their numeric order, the times they state, and safe frame ids of them."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable
from decimal import Decimal

from pseudolidar.formats.timestamps import NS_PER_S

# Times of day that names of recordings state, s since 1970: the years 2000 to 2100.
EARLIEST_S, LATEST_S = 946_684_800, 4_102_444_800
# What one unit of a stamp is, ns, by the digits before its decimal point.
STAMP_UNITS_NS = {18: 1, 19: 1, 15: 1_000, 16: 1_000, 12: 1_000_000, 13: 1_000_000}
_STAMP = re.compile(r"([0-9]{9,19})(\.[0-9]+)?")

# A file name has at most 255 bytes; the rest is for extensions and temporary names.
LONGEST_ID_BYTES = 160
# Illegal in names on some systems; the percent sign marks them; commas separate ids.
_UNSAFE = frozenset('<>:"/\\|?*%,')
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?:\.|\Z)", re.IGNORECASE)


def natural_key(name: str) -> tuple[tuple[int, str, int], ...]:
    """Sort key that puts `2` before `10`; equal numbers of other widths stay apart."""
    parts = re.split(r"([0-9]+)", name)
    return tuple(
        (int(part), "", len(part)) if at % 2 else (-1, part, 0) for at, part in enumerate(parts)
    )


def stamp_unit_ns(names: Iterable[str]) -> int | None:
    """Length of one unit, ns, if all names are times of day in one unit; None otherwise."""
    units = {_unit_ns(name) for name in names}
    return units.pop() if len(units) == 1 else None


def time_of_name_ns(name: str, unit_ns: int) -> int:
    """Time that a name states, exact, ns since 1970."""
    return int(Decimal(name) * unit_ns)


def safe_id(name: str) -> str:
    """A frame id that can name output files everywhere and stand in any text.

    What no file name or no UTF-8 text can hold (control characters, undecodable bytes, separators)
    is written as `%XX` of its bytes; different names stay different.
    """
    text = "".join(c if _is_safe(c) else _percent(c) for c in name) or "%"
    if text[0] == "." or _RESERVED.match(text):
        text = _percent(text[0]) + text[1:]
    data = text.encode()
    if len(data) <= LONGEST_ID_BYTES:
        return text
    digest = hashlib.sha256(data).hexdigest()[:16]
    return f"{data[: LONGEST_ID_BYTES - 17].decode(errors='ignore')}-{digest}"


def _unit_ns(name: str) -> int | None:
    match = _STAMP.fullmatch(name)
    if match is None:
        return None
    unit_ns = STAMP_UNITS_NS.get(len(match[1]), NS_PER_S)
    seconds = Decimal(name) * unit_ns / NS_PER_S
    return unit_ns if EARLIEST_S <= seconds <= LATEST_S else None


def _is_safe(c: str) -> bool:
    # Joined emoji need U+200D and U+FE0F, which do not count as printable.
    return (c.isprintable() or c in "\u200d\ufe0f") and c not in _UNSAFE


def _percent(c: str) -> str:
    try:
        data = os.fsencode(c)
    except UnicodeEncodeError:
        data = c.encode("utf-8", "surrogatepass")
    return "".join(f"%{byte:02X}" for byte in data)
