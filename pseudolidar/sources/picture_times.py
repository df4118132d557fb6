"""Times of pictures from a list that names them: matched by name, never by position."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path, PurePosixPath

from pseudolidar.errors import PseudolidarError, SequenceTime
from pseudolidar.formats.time_table import TimeTable
from pseudolidar.sources.names import natural_key, safe_id
from pseudolidar.sources.pairing import Pairing
from pseudolidar.sources.stamps import FrameTimes, read_frame_times

NAMES_SHOWN = 3


def times_by_name(pairing: Pairing, table: TimeTable) -> tuple[Pairing, FrameTimes]:
    """The pairs in order of the times that a list gives their left pictures.

    A name counts in full or without folders and extension. Pairs that the list does not name are
    refused; lines of pictures that are not there are told.

    Args:
        pairing: pairs in any order.
        table: times with names.

    Raises:
        SequenceTime: no picture is in the list, a name is there twice, or two times are equal.
    """
    entries = _Entries(table)
    timed, refused = [], list(pairing.unpaired)
    for pair in pairing.pairs:
        entry = entries.of(pair.left)
        if entry is None:
            refused.append((safe_id(pair.key), _untimed(table, pair.left)))
        else:
            timed.append((table.stamps_ns[entry] or 0, entry, pair))
    if not timed:
        raise SequenceTime(
            f"none of {len(pairing.pairs)} pictures is in it; it names "
            f"{', '.join(map(repr, entries.names[:NAMES_SHOWN]))}",
            want=f"names such as {pairing.pairs[0].left.name!r}",
            path=table.path,
        )
    timed.sort(key=lambda item: item[:2])
    for (before_ns, before, _), (time_ns, entry, _) in pairwise(timed):
        if before_ns == time_ns:
            raise SequenceTime(
                f"the same time as line {table.lines[before]}",
                want="a time of its own for each picture",
                path=table.path,
                where=f"line {table.lines[entry]}",
            )
    stamps = [time_ns for time_ns, _, _ in timed]
    times = read_frame_times(table.path, stamps, range(len(stamps)))
    notes = [table.note]
    unused = len(entries.names) - len(timed)
    if unused:
        notes.append(f"{table.path.name}: {unused} lines of pictures that are not there")
    pairs = tuple(pair for _, _, pair in timed)
    unpaired = tuple(sorted(refused, key=lambda item: natural_key(item[0])))
    return (
        replace(pairing, pairs=pairs, unpaired=unpaired),
        replace(times, notes=(*notes, *times.notes)),
    )


class _Entries:
    """Lines of a list by what they name."""

    def __init__(self, table: TimeTable) -> None:
        self._table = table
        self.names = table.names or ()
        self._by_stem: dict[str, list[int]] = defaultdict(list)
        for entry, name in enumerate(self.names):
            self._by_stem[_parts(name)[-1]].append(entry)

    def of(self, picture: Path) -> int | None:
        """The line of a picture: of lines with one name, the one in whose folders it is.

        Raises:
            SequenceTime: several lines name it.
        """
        found = self._by_stem.get(_stem(picture.name), [])
        if len(found) > 1:
            path = _parts(picture.as_posix())
            found = [e for e in found if path[-len(parts := _parts(self.names[e])) :] == parts]
        if len(found) > 1:
            raise SequenceTime(
                f"{picture.name!r} again, after line {self._table.lines[found[0]]}",
                want="each picture once",
                path=self._table.path,
                where=f"line {self._table.lines[found[1]]}",
            )
        return found[0] if found else None


def _parts(name: str) -> tuple[str, ...]:
    """Folders and the name without its extension."""
    parts = PurePosixPath(name.replace("\\", "/")).parts or ("",)
    return (*parts[:-1], _stem(parts[-1]))


def _stem(name: str) -> str:
    """A name without its extension; the decimals of a time are none."""
    stem, dot, ending = name.rpartition(".")
    return stem if dot and stem and not ending.isdecimal() else name


def _untimed(table: TimeTable, picture: Path) -> PseudolidarError:
    return SequenceTime(
        f"no line names {picture.name!r}",
        want="a time for each picture",
        fix="Add it, or leave the picture out.",
        path=table.path,
    )
