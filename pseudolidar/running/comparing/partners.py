"""Which frame of another source belongs to a frame: by name, by number, by time."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pseudolidar.errors import SourceEmpty
from pseudolidar.running.journal.identity import SYNTHETIC_TIME
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

_NUMBERS = re.compile(r"[0-9]+")
# Without a rhythm of its own a source's frames belong to moments this near, s.
NEAREST_S = 0.05
NS_PER_S = 1e9


@dataclass(frozen=True)
class Partners:
    """Frames that belong together.

    Args:
        indices: index in the other source by the id in ours.
        how: in words.
    """

    indices: Mapping[str, int]
    how: str


def partners_of(source: FrameSequence[Frame], other: FrameSequence[Frame]) -> Partners:
    """Pair the frames: equal names, else equal numbers in them, else the nearest time.

    Times that a source made up for itself pair nothing.

    Raises:
        SourceEmpty: no frame of the other source belongs to one of ours.
    """
    place = {name: index for index, name in enumerate(other.ids)}
    by_name = {name: place[name] for name in source.ids if name in place}
    if by_name:
        return Partners(by_name, f"{len(by_name)} of {len(source.ids)} frames by name")
    by_number = _by_number(source.ids, other.ids)
    if by_number:
        return Partners(by_number, f"{len(by_number)} of {len(source.ids)} frames by number")
    made_up = any(SYNTHETIC_TIME in n for each in (source, other) for n in each.summary.notes)
    by_time = {} if made_up else _by_time(source, other)
    if by_time:
        apart_s = [
            abs(source.timestamps_ns[source.ids.index(name)] - other.timestamps_ns[index])
            / NS_PER_S
            for name, index in by_time.items()
        ]
        apart = f"at most {1e3 * max(apart_s):.0f} ms apart"
        return Partners(by_time, f"{len(by_time)} of {len(source.ids)} frames by time, {apart}")
    raise SourceEmpty(
        f"frames such as {other.ids[0] if other.ids else 'none'}, none of which belongs to one of "
        f"{source.summary.line}",
        want="the same names or numbers, or times of the same clock",
        path=other.summary.path,
    )


def _by_number(ours: tuple[str, ...], theirs: tuple[str, ...]) -> dict[str, int]:
    """By all numbers in the names, where no two names of a source have the same."""
    numbers = [{tuple(map(int, _NUMBERS.findall(n))): n for n in ids} for ids in (ours, theirs)]
    mine, other = numbers
    if len(mine) < len(ours) or len(other) < len(theirs) or () in mine or () in other:
        return {}
    place = {name: index for index, name in enumerate(theirs)}
    return {name: place[other[key]] for key, name in mine.items() if key in other}


def _by_time(source: FrameSequence[Frame], other: FrameSequence[Frame]) -> dict[str, int]:
    times = np.array(other.timestamps_ns, np.int64)
    if not len(times):
        return {}
    gaps = [abs(after - before) for before, after in pairwise(other.timestamps_ns)]
    reach_ns = float(np.median(gaps)) / 2 if gaps else NEAREST_S * NS_PER_S
    found = {}
    for name, stamp in zip(source.ids, source.timestamps_ns, strict=True):
        apart = np.abs(times - stamp)
        nearest = int(apart.argmin())
        if apart[nearest] <= reach_ns:
            found[name] = nearest
    return found
