from __future__ import annotations

from dataclasses import dataclass

import pytest

from pseudolidar.errors import SourceEmpty
from pseudolidar.running.comparing.partners import partners_of
from pseudolidar.running.journal.identity import SYNTHETIC_TIME
from pseudolidar.sources.source import SourceSummary

MS = 1_000_000


@dataclass(frozen=True)
class Listed:
    """The list of a source's frames, which is all that pairing looks at."""

    ids: tuple[str, ...]
    timestamps_ns: tuple[int, ...]
    notes: tuple[str, ...] = ()

    @property
    def summary(self) -> SourceSummary:
        return SourceSummary("listed", "here", "a list", notes=self.notes)


def listed(ids: str, times_ms: list[int], *notes: str) -> Listed:
    return Listed(tuple(ids.split()), tuple(t * MS for t in times_ms), notes)


def test_equal_names_go_first_even_where_times_say_otherwise():
    found = partners_of(listed("a b c", [0, 100, 200]), listed("c a x", [0, 100, 200]))
    assert found.indices == {"a": 1, "c": 0}
    assert "2 of 3 frames by name" in found.how


def test_numbers_where_no_name_is_equal():
    found = partners_of(
        listed("000007_10 000009_10", [0, 100]), listed("frame9-10 frame7-10", [0, 100])
    )
    assert found.indices == {"000007_10": 1, "000009_10": 0}


def test_the_nearest_time_within_half_the_rhythm_of_the_other():
    ours = listed("a b c d", [10, 95, 160, 900])
    found = partners_of(ours, listed("x y z", [0, 100, 200]))
    # 160 is 40 ms from z; 900 is from none
    assert found.indices == {"a": 0, "b": 1, "c": 2}
    assert "at most 40 ms apart" in found.how


def test_times_that_were_made_up_pair_nothing():
    made_up = listed("x y", [0, 100], f"{SYNTHETIC_TIME}, 10 Hz")
    for pair in ((listed("a b", [0, 100]), made_up), (made_up, listed("a b", [0, 100]))):
        with pytest.raises(SourceEmpty, match="none of which belongs"):
            partners_of(*pair)
