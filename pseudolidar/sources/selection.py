"""Choosing frames of a source."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, Self, TypeVar

from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.formats.text import read_lines
from pseudolidar.sources.names import natural_key
from pseudolidar.sources.source import FrameSequence, SourceSummary
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.recorded import Frame

AnyFrame = TypeVar("AnyFrame", bound=Frame)

_SLICE = re.compile(r"(-?[0-9]+)?:(-?[0-9]+)?(?::(-?[0-9]+)?)?")
_NUMBERS = re.compile(r"[0-9]+")


@dataclass(frozen=True)
class FrameSelection:
    """Frames by position or by id, as written on the command line.

    `100:400:2` and `0::2` are slices of positions; `13,35,41` are ids, in full or by their number
    (`13` for `000013_10`); both may be mixed by commas; `@FILE` holds such items line by line.

    Args:
        items: slices and ids.
    """

    items: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """The selection that `text` writes; a file is read at once.

        Raises:
            UsageError: nothing in it, an illegal slice, or no such file.
        """
        parts = _lines(Path(text[1:])) if text.startswith("@") else [text]
        items = tuple(item.strip() for part in parts for item in part.split(",") if item.strip())
        if not items:
            raise UsageError(f"no frame in {text!r}", want="such as 100:400:2 or 13,35,41")
        for item in items:
            if ":" in item:
                _slice(item)
        return cls(items)

    def __str__(self) -> str:
        return ",".join(self.items)

    def positions(self, ids: Sequence[str], refused: Sequence[str] = ()) -> set[int]:
        """Positions in `ids` that are selected; `refused` are ids that may be named too.

        Raises:
            UsageError: an id is in neither; names the nearest.
        """
        place = {frame_id: index for index, frame_id in enumerate(ids)}
        known = FrameIds([*ids, *refused])
        chosen: set[int] = set()
        for item in self.items:
            if ":" in item:
                chosen.update(range(len(ids))[_slice(item)])
            elif (name := known.find(item)) in place:
                chosen.add(place[name])
        return chosen

    def refused_ids(self, ids: Sequence[str], refused: Sequence[str]) -> set[str]:
        """Which of the `refused` ids are selected: by name, or among the frames of a slice."""
        known = FrameIds([*ids, *refused])
        chosen = {known.find(item) for item in self.items if ":" not in item}
        for item in self.items:
            inside = ids[_slice(item)] if ":" in item else ()
            order = [natural_key(name) for name in inside]
            if order:
                low, high = min(order), max(order)
                chosen.update(name for name in refused if low <= natural_key(name) <= high)
        return chosen.intersection(refused)


def select(
    source: FrameSequence[AnyFrame],
    frames: FrameSelection | None = None,
    exclude: FrameSelection | None = None,
) -> FrameSequence[AnyFrame]:
    """The source reduced to `frames` without `exclude`; order, ids and frame indices stay.

    Raises:
        UsageError: an unknown id, or no frame is left.
    """
    if frames is None and exclude is None:
        return source
    ids, names = source.ids, tuple(name for name, _ in source.refused)
    refused = set(names) if frames is None else frames.refused_ids(ids, names)
    if exclude is not None:
        refused -= exclude.refused_ids(ids, names)
    chosen = chosen_positions(ids, names, frames, exclude, empty=bool(refused))
    return SelectedSource(
        source,
        tuple(sorted(chosen)),
        tuple((name, error) for name, error in source.refused if name in refused),
    )


def chosen_positions(
    ids: Sequence[str],
    refused: Sequence[str],
    frames: FrameSelection | None,
    exclude: FrameSelection | None,
    *,
    empty: bool = False,
) -> set[int]:
    """Positions in `ids` of `frames` without `exclude`.

    Args:
        ids: names of the frames.
        refused: names of frames that may be named, but cannot be used.
        frames: these; None for all.
        exclude: not these; None for none of them.
        empty: whether nothing left is an answer.

    Raises:
        UsageError: an unknown id, or no frame is left.
    """
    chosen = set(range(len(ids))) if frames is None else frames.positions(ids, refused)
    if exclude is not None:
        chosen -= exclude.positions(ids, refused)
    if not chosen and not empty:
        raise UsageError(
            f"no frame of {len(ids)} is left by the selection",
            want=f"positions 0 to {len(ids) - 1}, or ids such as {ids[0]!r}" if ids else "",
        )
    return chosen


def whole(source: FrameSequence[AnyFrame]) -> FrameSequence[AnyFrame]:
    """What `select` took frames from: its positions are the frames' own indices."""
    return source.source if isinstance(source, SelectedSource) else source


@dataclass(frozen=True, eq=False)
class SelectedSource(Generic[AnyFrame]):
    """Some frames of a source.

    Args:
        source: the whole.
        chosen: positions in it, increasing.
        refused: which of its unusable frames were asked for.
    """

    source: FrameSequence[AnyFrame]
    chosen: tuple[int, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]

    @property
    def summary(self) -> SourceSummary:
        """What it is, and how much of it."""
        whole = self.source.summary
        part = f"frames: {len(self.chosen)} of {len(self.source.ids)} selected"
        return replace(whole, notes=(*whole.notes, part))

    @property
    def yields(self) -> type[AnyFrame]:
        """What its frames are."""
        return self.source.yields

    @property
    def rig(self) -> StereoRig | None:
        """Rig of the whole."""
        return self.source.rig

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the selected frames."""
        return tuple(self.source.ids[index] for index in self.chosen)

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Times of the selected frames."""
        return tuple(self.source.timestamps_ns[index] for index in self.chosen)

    def load(self, index: int) -> AnyFrame:
        """Selected frame `index`; its own index is that in the whole."""
        return self.source.load(self.chosen[index])


class FrameIds:
    """Ids of a source, found by their text or by the first or last number in it.

    Args:
        ids: in the order of the source.
    """

    def __init__(self, ids: Sequence[str]) -> None:
        self.ids = ids
        self.exact = set(ids)
        self.first = _by_number(ids, 0)
        self.last = _by_number(ids, -1)

    def find(self, item: str) -> str:
        """The id that `item` means.

        Raises:
            UsageError: none, or several.
        """
        found = self.meant(item)
        if found is None:
            raise UsageError(
                f"no frame {item!r}", want=f"an id such as {self._nearest(item)}", where="frames"
            )
        return found

    def meant(self, item: str) -> str | None:
        """The id that a text means; None where it means none or several."""
        if item in self.exact:
            return item
        if _NUMBERS.fullmatch(item):
            for table in (self.first, self.last):
                found = table.get(int(item), [])
                if len(found) == 1:
                    return found[0]
        return None

    def _nearest(self, item: str) -> str:
        if _NUMBERS.fullmatch(item) and self.first:
            nearest = min(self.first, key=lambda number: abs(number - int(item)))
            return repr(self.first[nearest][0])
        near = difflib.get_close_matches(item, self.ids, n=1, cutoff=0)
        return repr(near[0]) if near else "none: the source has no frame"


def _by_number(ids: Iterable[str], which: int) -> dict[int, list[str]]:
    table: dict[int, list[str]] = {}
    for name in ids:
        numbers = _NUMBERS.findall(name)
        if numbers:
            table.setdefault(int(numbers[which]), []).append(name)
    return table


def _slice(item: str) -> slice:
    match = _SLICE.fullmatch(item)
    if match is None or (match[3] and int(match[3]) < 1):
        raise UsageError(f"slice {item!r}", want="START:STOP:STEP such as 100:400:2, step above 0")
    return slice(*(None if part is None else int(part) for part in match.groups()))


def _lines(file: Path) -> list[str]:
    lines = read_lines(file, error=UsageError)
    return [line.text.partition("#")[0] for line in lines]
